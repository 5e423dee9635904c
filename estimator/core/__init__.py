"""What computes: the filter, its model and its law as C, and how Python calls it."""
