"""One module per figure. Each has `draw(material)`: a `Drawing`, or None when the run has no data for it."""
