"""The board that the service operates: held by a process of its own, so that the service may die without it."""
