"""Today's estimator on yesterday's record."""
