"""The page in a real browser, against `hil serve` with an emulated board on a pty."""
