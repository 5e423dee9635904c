"""The verb characterise: what a gyro is worth, in the figures of a data sheet."""
