"""report.html of a trace: what the residual held, what the model lacked, and the error before and after."""

from hil.report.diagnosis.page import write_report

__all__ = ["write_report"]
