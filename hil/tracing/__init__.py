"""`hil trace`: from a record to the effect that the model lacks: which part, by which tracer, what is written."""
