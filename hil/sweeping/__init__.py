"""`hil sweep`: campaigns, many runs on emulated boards that differ in keys of scenario and bench, as one data set."""
