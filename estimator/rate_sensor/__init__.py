"""Sensors that put out a rate as a voltage: base model, what it may lack, and how a record tells."""
