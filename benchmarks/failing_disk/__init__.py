"""A disk that fails on request: at the k-th call of a run that changes something below its folder."""

from benchmarks.failing_disk.disk import FAULTS, Disk, Fault

__all__ = ["FAULTS", "Disk", "Fault"]
