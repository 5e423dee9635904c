"""Whether the model of a run is complete: a scan of its record, what that excludes, and what it means for the angle."""
