"""A ring-down of which only the amplitude is recorded: its law of damping, by the averaged equation of motion."""
