"""`hil export`: what a run recorded and estimated, for other programs: CSV, Parquet, MAT, MCAP."""
