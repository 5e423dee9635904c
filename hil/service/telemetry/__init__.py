"""What a run does while it lasts, for whoever looks: one more reader of its rings, decimated for each."""
