"""What the innovation of an observer still holds: its noise floor, lines, dependences, and whom they point at."""
