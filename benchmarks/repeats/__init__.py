"""Whether coefficients scatter from repeat to repeat as their intervals say."""

from benchmarks.repeats.rows import rows

__all__ = ["rows"]
