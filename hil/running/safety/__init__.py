"""The board as something that may do harm: looked at before it is armed, watched, stopped, and brought to SAFE."""
