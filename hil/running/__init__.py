"""`hil run`, the host's side of the loop: handshake, the real-time worker, the run as a whole."""
