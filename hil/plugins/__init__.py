"""Algorithms of one's own in the loop: what they are given, how they are found, and what stands between them and it."""
