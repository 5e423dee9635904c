"""report.html of a sensor that was recorded, not driven: what came, whether it came whole, and how it drifts."""

from hil.report.sensor.page import write_report

__all__ = ["write_report"]
