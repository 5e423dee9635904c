"""One module per figure, with a function of the run's material: a `Drawing`, or None where the run lacks its data."""
