"""A board's bench file from an experiment: what it does is measured, and held against what it says of itself."""
