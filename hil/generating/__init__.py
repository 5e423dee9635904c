"""`hil generate`: what a bench file says as C99 for a board, the core's own text, cut down to what it declares."""
