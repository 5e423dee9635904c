"""`hil doctor`: what this machine and one link can honestly hold, what is missing, and how to get it."""
