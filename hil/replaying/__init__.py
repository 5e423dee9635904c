"""`hil replay`: today's estimator on yesterday's record."""
