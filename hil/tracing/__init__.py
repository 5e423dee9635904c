"""From a record to the effect that the model lacks: which part is looked at, by which tracer, what is written."""
