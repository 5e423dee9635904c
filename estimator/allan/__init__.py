"""The noise of a rate at rest: its Allan deviation, how sure that is, what it says of the noise."""
