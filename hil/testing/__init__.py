"""Acceptance tests for pytest: a board, a sensor or a record under test, and what a package that brings one keeps."""
