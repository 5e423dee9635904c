"""Verdicts as JUnit XML, which continuous integration reads: a test case for each run and trace."""

from collections.abc import Iterable
from typing import NamedTuple
from xml.etree import ElementTree as Xml

from hil.errors import printable

PASSED = ("good", "adequate", "explained")
_FAILED = ("failed", "unsafe", "partly explained", "unexplained")


class Case(NamedTuple):
    """A run or a trace: its folder's name; device; verdict, "" without one; bench seconds; why, a line each."""

    name: str
    device: str
    verdict: str
    seconds: float | None
    reasons: tuple[str, ...] = ()


def junit_xml(cases: Iterable[Case], suite: str) -> str:
    """The test suite: a verdict against a run is a failure; without a verdict, or interrupted, it is an error."""
    told = list(cases)
    failed = [one for one in told if one.verdict in _FAILED]
    broken = [one for one in told if one.verdict not in _FAILED and one.verdict not in PASSED]
    counts = {"tests": str(len(told)), "failures": str(len(failed)), "errors": str(len(broken)), "skipped": "0"}
    total = f"{sum(one.seconds or 0.0 for one in told):.3f}"
    root = Xml.Element("testsuites", counts | {"time": total})
    parent = Xml.SubElement(root, "testsuite", {"name": printable(suite), **counts, "time": total})
    for one in told:
        case = Xml.SubElement(
            parent,
            "testcase",
            {
                "name": printable(one.name),
                "classname": printable(one.device or "run"),
                "time": f"{one.seconds or 0.0:.3f}",
            },
        )
        if one.verdict not in PASSED:
            kind = "failure" if one.verdict in _FAILED else "error"
            verdict = one.verdict or "no verdict"
            reason = printable("; ".join(one.reasons)) or verdict
            Xml.SubElement(case, kind, {"type": verdict, "message": reason}).text = "\n".join(
                map(printable, one.reasons)
            )
    Xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"
