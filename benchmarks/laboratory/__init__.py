"""Records as laboratories have them: emulated by SciPy with known truth, imported by a map, traced."""

from benchmarks.laboratory.rows import rows

__all__ = ["rows"]
