"""What developers of the bench need and its users do not; no part of what is installed."""
