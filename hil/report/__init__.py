"""report.html: a run as a page for people. One file, no outside resources, figures drawn as inline SVG."""

from hil.report.page import write_report

__all__ = ["write_report"]
