"""What a bench file says as C99 for a board: the core's own text, cut down to what that file declares."""
