"""Campaigns: the file, the design, what is kept, the dependence, runs on this machine and on a cluster."""
