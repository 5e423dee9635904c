"""What a gyro is worth: figures of its data sheet from a record, each with its interval (IEEE Std 1431, 952)."""
