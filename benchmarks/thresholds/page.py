"""docs/results/thresholds.md: what changes at half and at double of each threshold."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from benchmarks.thresholds.change import SIDES, changed
from estimator.thresholds import THRESHOLDS, Threshold, each

_INTRODUCTION = """\
# What the thresholds of tracing do

Each of the [thresholds](../reference/thresholds.md) halved, and doubled, on a fixed set of short records: what tracing
answers then, where that is another answer. `python -m benchmarks.thresholds` measures it (`--help` says how), the
answers, and which records read which threshold, are kept in [thresholds.json](thresholds.json). Where nothing changes,
the records do not resolve the threshold: half and double of it do as well there. The records show whether a threshold
does anything and which way it errs; how often an answer is right is a matter of the [campaigns](undeclared.md).
"""


def page(found: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    baseline = found["baseline"]
    measured = f"Measured {found['date']}; thresholds that are younger are open." if "date" in found else ""
    lines = [_INTRODUCTION, measured, "", "| record | as the thresholds are |", "|---|---|"]
    lines += [f"| {record} | {answer['verdict']} |" for record, answer in baseline.items()]
    for group in fields(THRESHOLDS):
        own = [one for one in each(THRESHOLDS) if one.name.startswith(f"{group.name}.")]
        lines += ["", f"## {group.name}", "", "| threshold | is | why | half | double |", "|---|---|---|---|---|"]
        lines += [_row(one, found) for one in own]
    if left := [one.name for one in each(THRESHOLDS) if not all(_measured(one.name, side, found) for side in SIDES)]:
        lines += ["", "## Open", "", _LEFT, "", ", ".join(f"`{name}`" for name in left)]
    return "\n".join(lines) + "\n"


_LISTED = 3  # by name, of the records on which nothing changes

_LEFT = "On no record is it known yet what these do at half or at double, or they are younger than the measurement."


def _row(one: Threshold, found: Mapping[str, Any]) -> str:
    cells = [f"`{one.name}`", f"{_number(one.value)} {one.unit}", one.reason]
    cells += [f"{_number(changed(one.value, side))}: {_answered(one.name, side, found)}" for side in SIDES]
    return f"| {' | '.join(cells)} |"


def _answered(name: str, side: str, found: Mapping[str, Any]) -> str:
    answers = found[side].get(name, {})
    told = [_said(record, one, one.get("beside", found["baseline"][record])) for record, one in answers.items()]
    asked = _measured(name, side, found)
    if not asked:
        return "not known yet"
    same = [record for record in asked if record not in answers]
    if not same:
        return "; ".join(told)
    listed = ", ".join(f"“{record}”" for record in same)
    where = listed if len(same) <= _LISTED else f"{len(same)} more" if told else f"all {len(same)} that read it"
    return "; ".join([*told, f"the same on {where}"])


def _measured(name: str, side: str, found: Mapping[str, Any]) -> list[str]:
    """The records of which it is known what they answer."""
    return [record for record in found["read"].get(name, ()) if record not in found["open"][side].get(name, ())]


def _said(record: str, answer: Mapping[str, Any], before: Mapping[str, Any]) -> str:
    if answer["verdict"] != before["verdict"]:
        return f"{record}: {answer['verdict']}"
    more = [f"+ {word}" for word in answer["words"] if word not in before["words"]]
    less = [f"− {word}" for word in before["words"] if word not in answer["words"]]
    # Where it is that of a tracer before, the answer by the thresholds as they are may have been another one.
    return f"{record}: {', '.join([*more, *less]) or answer['verdict']}"


def _number(value: Any) -> str:
    return ", ".join(map(_number, value)) if isinstance(value, tuple) else f"{value:.4g}"
