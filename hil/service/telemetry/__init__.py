"""What a run does while it lasts, for each client: one more reader of its rings, decimated."""
