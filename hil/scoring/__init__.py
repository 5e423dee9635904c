"""`hil score`: a run beside the truth that its emulated board wrote: errors, NEES, coverage."""
