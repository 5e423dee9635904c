"""evaluation/results/comparison.md and its figure."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.comparison.summary import Pooled
from hil.numbers import quantity, relative, significant
from hil.records.atomic import write_text
from hil.report import theme

_BEGIN, _END = "<!-- figures: begin -->", "<!-- figures: end -->"
_HEAD = (
    "method", "angle error, rms", "of the records", "rate error, rms", "stiffness error", "diverged", "settled",
    "a sample",
)  # fmt: skip


def write_page(path: Path, tables: Mapping[str, Sequence[Pooled]], counts: Mapping[str, int]) -> None:
    """Put the tables between the marks of the page, which is otherwise left as it is, and draw its figure."""
    lines = [_BEGIN, ""]
    for case, rows in tables.items():
        lines += [f"### {case[0].upper()}{case[1:]}: {counts[case]} records", ""]
        lines += ["| " + " | ".join(_HEAD) + " |", "|" + "---|" * len(_HEAD)]
        lines += ["| " + " | ".join(_cells(row, counts[case])) + " |" for row in rows]
        lines.append("")
    text = path.read_text(encoding="utf-8") if path.exists() else f"# Methods beside one another\n\n{_BEGIN}\n{_END}\n"
    before, rest = text.split(_BEGIN)
    write_text(path, before + "\n".join(lines) + rest[rest.index(_END) :])
    write_error_figure(path.with_suffix(".svg"), tables)


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


def write_error_figure(path: Path, tables: Mapping[str, Sequence[Pooled]]) -> None:
    """Angle errors of every method: a dot a record, a bar for all; a panel a case."""
    from matplotlib.figure import Figure

    with theme.drawing_style():
        figure = Figure(figsize=(theme.WIDTH_IN, 4.6))
        panels = figure.subplots(1, len(tables), sharey=True, squeeze=False)[0]
        for ax, (case, rows) in zip(panels, tables.items(), strict=True):
            for place, row in enumerate(rows):
                colour = {"prior art": theme.SECOND, "bound": theme.INK}.get(row.kind, theme.FIRST)
                angles = [angle for angle in row.angles if np.isfinite(angle)]
                ax.plot(angles, [place] * len(angles), ".", color=colour, alpha=0.45, markersize=4)
                if np.isfinite(row.angle):
                    ax.plot([row.angle], [place], "|", color=colour, markersize=11, markeredgewidth=1.8)
                if row.kind == "bound":
                    ax.axvline(row.angle, color=theme.INK, linewidth=0.7, dashes=(4, 3))
            ax.set_xscale("log")
            ax.set_title(case)
            ax.set_xlabel("angle error, rms / rad")
        names = [row.name for row in next(iter(tables.values()))]
        panels[0].set_yticks(range(len(names)), names, fontsize=7)
        panels[0].invert_yaxis()
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None}, facecolor="white")
