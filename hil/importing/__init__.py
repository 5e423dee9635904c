"""`hil import`: a file from elsewhere becomes a capture: delimited text, MATLAB, Parquet, by a map of its columns."""
