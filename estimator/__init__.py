"""Pure estimation: numbers in, numbers out.  No I/O on the way of a sample, no clocks, no wire."""
