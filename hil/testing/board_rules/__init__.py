"""What docs/wire.md and docs/safety.md ask of a board, as tests of any board on any link."""
