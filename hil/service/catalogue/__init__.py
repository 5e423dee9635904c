"""What runs, traces and devices there are: a database beside the run folders, made of them and never more than them."""
