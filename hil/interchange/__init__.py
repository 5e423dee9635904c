"""Records in and out: interchange CSV, CSV files that look different (by a map), Parquet."""
