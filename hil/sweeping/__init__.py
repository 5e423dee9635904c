"""Campaigns: many runs on emulated boards that differ in keys of scenario and bench, kept as one data set."""
