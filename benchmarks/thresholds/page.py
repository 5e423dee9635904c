"""docs/results/thresholds.md: what changes at half and at double of each threshold."""

from collections.abc import Mapping
from typing import Any

from benchmarks.thresholds.change import SIDES, changed
from estimator.trace.thresholds import THRESHOLDS, Threshold, each

_INTRODUCTION = """\
# What the thresholds of tracing do

Each of the [thresholds](../reference/thresholds.md) halved, and doubled, on a fixed set of short records: what tracing
answers then, where that is another answer. `python -m benchmarks.thresholds` measures it (`--help` says how), the
answers are kept in [thresholds.json](thresholds.json). The records show whether a threshold does anything and which way
it errs; how often an answer is right is a matter of the [campaigns](undeclared.md).
"""


def page(found: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    baseline = found["baseline"]
    lines = [_INTRODUCTION, "| record | as the thresholds are |", "|---|---|"]
    lines += [f"| {record} | {answer['verdict']} |" for record, answer in baseline.items()]
    told = [one for one in each(THRESHOLDS) if any(one.name in found[side] for side in SIDES)]
    lines += ["", "## Those that change an answer", "", "| threshold | is | half | double |", "|---|---|---|---|"]
    lines += [_row(one, found) for one in told]
    silent = [one.name for one in each(THRESHOLDS) if one not in told and not _open(one.name, found)]
    lines += ["", "## Those that change none", "", _INERT, ""]
    lines += [f"- `{name}`{_read(name, found)}" for name in silent]
    if left := [one.name for one in each(THRESHOLDS) if _open(one.name, found)]:
        lines += ["", "## Not told apart yet", "", _LEFT, "", ", ".join(f"`{name}`" for name in left)]
    return "\n".join(lines) + "\n"


_INERT = (
    "Neither half nor double changes what is said of these records. That is what a threshold between two clear cases "
    "looks like, and what a superfluous one looks like, too."
)
_LEFT = (
    "These were changed together with others, some answer changed, and the time given was over before it was known by "
    "whom; or they were not asked at all."
)


def _row(one: Threshold, found: Mapping[str, Any]) -> str:
    cells = [f"`{one.name}`", _number(one.value)]
    for side in SIDES:
        answers = found[side].get(one.name, {})
        said = "; ".join(_said(record, answer, found["baseline"][record]) for record, answer in answers.items())
        still = " (not all told apart)" if one.name in found["open"][side] else ""
        cells.append(f"{_number(changed(one.value, side))}: {said or 'the same'}{still}")
    return f"| {' | '.join(cells)} |"


def _said(record: str, answer: Mapping[str, Any], before: Mapping[str, Any]) -> str:
    if answer["verdict"] != before["verdict"]:
        return f"{record}: {answer['verdict']}"
    more = [f"+ {word}" for word in answer["words"] if word not in before["words"]]
    less = [f"− {word}" for word in before["words"] if word not in answer["words"]]
    return f"{record}: {', '.join([*more, *less])}"


def _open(name: str, found: Mapping[str, Any]) -> bool:
    if name not in found["read"]:
        return True  # younger than the measurement
    return any(name in found["open"][side] for side in SIDES) and not any(name in found[side] for side in SIDES)


def _read(name: str, found: Mapping[str, Any]) -> str:
    count = len(found["read"].get(name, ()))
    return f", read on {count} of the records" if count else ", read on none of them"


def _number(value: Any) -> str:
    return ", ".join(map(_number, value)) if isinstance(value, tuple) else f"{value:.4g}"
