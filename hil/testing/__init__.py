"""Acceptance tests of a board, for pytest."""
