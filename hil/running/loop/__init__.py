"""The loop's iteration in each mode: samples in, drives out, limits, gaps, trim electrodes."""
