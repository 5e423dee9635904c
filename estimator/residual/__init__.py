"""What an innovation still holds: its noise floor, its memory, its lines."""
