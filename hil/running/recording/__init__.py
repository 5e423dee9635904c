"""From the loop to the disk: rings in shared memory, the process that empties them, the record files of a run."""
