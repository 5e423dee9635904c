"""A run beside the truth, and beside another run."""
