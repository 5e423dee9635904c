"""Sensors that speak their maker's framing: adapters that turn it into the bench's samples, and their records."""
