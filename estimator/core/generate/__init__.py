"""From declarations to C: `python -m estimator.core.generate FILE` writes model.h, `generated` returns it."""
