"""The tour of the README and the tutorial, word for word."""
