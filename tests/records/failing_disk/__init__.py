"""A disk that fails on request: at the k-th call of a run that changes something below its folder."""

from tests.records.failing_disk.disk import FAULTS, Disk, Fault

__all__ = ["FAULTS", "Disk", "Fault"]
