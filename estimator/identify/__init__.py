"""A two-axis oscillator from a record of its drive and its sense voltages, by maximum likelihood."""
