"""`hil record`: sensors that speak their maker's framing, adapters to the bench's samples, and their records."""
