"""The coefficients that were found, with their 95 % intervals, beside the zero that they are not."""

import numpy as np

from estimator.diagnosis import Interval
from hil.numbers import percent
from hil.report.diagnosis.material import Material
from hil.report.figures.drawing import Drawing
from hil.report.theme import FIRST, MUTED, new_figure

_VISIBLE = 0.02
"""Of the estimate: half an interval that a drawing shows."""

_WIDEST = 5.0
"""Of the estimate: half an interval beside which the others still show, unlike that of a start that has waned."""


def intervals_figure(material: Material) -> Drawing | None:
    """Every coefficient that is known at all over its own estimate, so that all share one scale; none where no interval
    could be seen on it.  The table has the figures of all.
    """
    known = [
        (symbol, found)
        for effect in material.found.effects
        for symbol, found in effect.coefficients.items()
        if found.value and np.isfinite([found.low, found.high]).all() and found.high > found.low
    ]
    entries = [(symbol, found) for symbol, found in known if _half(found) < _WIDEST * abs(found.value)]
    if not any(_half(found) > _VISIBLE * abs(found.value) for _, found in entries):
        return None
    figure = new_figure(0.55 + 0.26 * len(entries))
    ax = figure.subplots()
    rows = np.arange(len(entries))[::-1]
    half = []
    for row, (_, found) in zip(rows, entries, strict=True):
        ends = sorted((found.low / found.value, found.high / found.value))
        ax.plot(ends, [row, row], color=FIRST, linewidth=2.2)
        ax.plot([1.0], [row], "o", color=FIRST, markersize=4)
        half.append((ends[1] - ends[0]) / 2.0)
        ax.annotate(
            f"± {percent(half[-1], 1 if half[-1] > 0.01 else 2)}", (ends[1], row), xytext=(6, 0),
            textcoords="offset points", va="center", fontsize=8, color=MUTED,
        )  # fmt: skip
    ax.axvline(0.0, color=MUTED, linewidth=0.9, dashes=(4, 3))
    reach = max(half)
    ax.set_xlim(min(-0.05, 1.0 - 1.2 * reach), 1.0 + max(1.5 * reach, 0.25))
    ax.set_ylim(-0.6, len(entries) - 0.4)
    ax.set_yticks(rows, [symbol for symbol, _ in entries])
    ax.grid(False, axis="y")
    ax.set_xlabel("coefficient / its estimate")
    caption = "Each coefficient over its own estimate, with its 95 % interval; dashed: zero, no effect."
    if left := [symbol for symbol, found in known if _half(found) >= _WIDEST * abs(found.value)]:
        caption += f" Of {', '.join(left)} the record tells nothing."
    return Drawing(figure, "Coefficients", caption, caption)


def _half(found: Interval) -> float:
    return 0.5 * (found.high - found.low)
