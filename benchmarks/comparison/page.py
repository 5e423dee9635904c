"""The tables of evaluation/results/comparison.md."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.comparison.summary import Pooled
from hil.numbers import quantity, relative, significant
from hil.records.atomic import write_text

_BEGIN, _END = "<!-- figures: begin -->", "<!-- figures: end -->"
_HEAD = (
    "method", "angle error, rms", "of the records", "rate error, rms", "stiffness error", "diverged", "settled",
    "a sample",
)  # fmt: skip


def write_page(path: Path, tables: Mapping[str, Sequence[Pooled]], counts: Mapping[str, int]) -> None:
    """Put the tables between the marks of the page, which is otherwise left as it is."""
    lines = [_BEGIN, ""]
    for case, rows in tables.items():
        lines += [f"### {case[0].upper()}{case[1:]}: {counts[case]} records", ""]
        lines += ["| " + " | ".join(_HEAD) + " |", "|" + "---|" * len(_HEAD)]
        lines += ["| " + " | ".join(_cells(row, counts[case])) + " |" for row in rows]
        lines.append("")
    text = path.read_text(encoding="utf-8") if path.exists() else f"# Methods beside one another\n\n{_BEGIN}\n{_END}\n"
    before, rest = text.split(_BEGIN)
    write_text(path, before + "\n".join(lines) + rest[rest.index(_END) :])


def _cells(row: Pooled, count: int) -> tuple[str, ...]:
    least, largest = min(row.angles), max(row.angles)
    return (
        row.name,
        quantity(row.angle, "rad"),
        f"{quantity(least, 'rad')} to {quantity(largest, 'rad')}",
        "" if row.rate is None else quantity(row.rate, "rad/s"),
        "" if row.stiffness is None else relative(row.stiffness).lstrip("+"),
        "" if not row.diverged else f"{row.diverged} of {count}",
        ""
        if row.kind == "bound"
        else f"{len(row.settled)} of {count}"
        + (f", {significant(float(np.median(row.settled)), 2)} s" if row.settled else ""),
        "" if row.cost_us is None else f"{significant(row.cost_us, 2)} µs",
    )
