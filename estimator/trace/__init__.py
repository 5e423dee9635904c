"""Tracing: from the residual of a record to the effect that the model lacks."""
