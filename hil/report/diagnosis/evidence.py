"""How much each candidate explains: the gain of those that were fitted, beside the predicted gain of the others."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from estimator import diagnosis as traced
from hil.numbers import count, significant
from hil.records import diagnosis as written
from hil.report.diagnosis.material import Material
from hil.report.figures.drawing import Drawing
from hil.report.theme import FIRST, INK, MUTED, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST = 14
_NAMED, _FITTED, _UNFITTED = "named", "fitted, not named", "not fitted"
_LOOKS: dict[str, dict[str, Any]] = {
    _NAMED: {"facecolor": FIRST, "alpha": 0.8},
    _FITTED: {"facecolor": MUTED, "alpha": 0.8},
    _UNFITTED: {"facecolor": "none", "edgecolor": MUTED, "hatch": "/////", "linewidth": 0.8},
}
_SAYS = {
    _NAMED: "Blue: the named effect, with the gain in log-likelihood of the observer that includes it",
    _FITTED: "Grey: fitted candidates that are not named, with their gain when they were last fitted",
    _UNFITTED: "Hatched: candidates that were not fitted, with the gain that a score test of the residual predicts",
}


class Bar(NamedTuple):
    """A candidate: its name, what it gained or would gain, and its group."""

    name: str
    size: float
    group: str


def evidence_figure(material: Material) -> Drawing | None:
    """Horizontal bars of the gain in log-likelihood, in groups: the gain of a fitted model is no predicted gain."""
    bars = bars_of(material.found)
    if len(bars) < 2:
        return None
    figure = new_figure(0.75 + 0.21 * len(bars))
    ax = figure.subplots()
    draw_bars(ax, bars)
    groups = [group for group in _LOOKS if any(bar.group == group for bar in bars)]
    caption = ". ".join(_SAYS[group] for group in groups) + "."
    if _UNFITTED in groups and len(groups) > 1:
        caption += " Compare lengths among fitted candidates, and among those that were not fitted, not across."
    caption += " Effects of one ambiguity group have nearly the same gain, and chance gives a few units."
    listed = "; ".join(
        f"{group}: " + ", ".join(f"{bar.name} {significant(bar.size)}" for bar in bars if bar.group == group)
        for group in groups
    )
    return Drawing(figure, "Evidence for the candidates", caption, f"Bars, {listed}. {caption}")


def bars_of(found: traced.Diagnosis | written.Diagnosis) -> list[Bar]:
    """By group, in each the largest first, as many as a figure holds; named ones as they were taken."""
    named = [Bar(effect.name, effect.evidence, _NAMED) for effect in found.effects if effect.evidence is not None]
    fitted = [Bar(one.name, one.gain, _FITTED) for one in found.rejected if one.gain is not None]
    predicted = [
        Bar(one.name, one.evidence, _UNFITTED)
        for one in found.rejected
        if one.gain is None and one.evidence is not None
    ]
    largest = [sorted(group, key=lambda bar: -bar.size) for group in (fitted, predicted)]
    return [bar for group in (named, *largest) for bar in group if math.isfinite(bar.size)][:_MOST]


def draw_bars(ax: "Axes", bars: list[Bar]) -> None:
    """Horizontal bars on a scale of powers of ten, each with its number."""
    sizes = [max(bar.size, 1.0) for bar in bars]
    rows = np.arange(len(bars))[::-1]
    for group, look in _LOOKS.items():
        ours = [at for at, bar in enumerate(bars) if bar.group == group]
        if ours:
            ax.barh(rows[ours], [sizes[at] for at in ours], height=0.62, label=group, **look)
    ax.set_xscale("log")
    ax.set_xlim(1.0, 2.5 * max(sizes))
    ax.set_yticks(rows, [bar.name.replace("_", " ") for bar in bars])
    for row, size, bar in zip(rows, sizes, bars, strict=True):
        ax.annotate(
            significant(bar.size), (size, row), xytext=(4, 0), textcoords="offset points", va="center", fontsize=8,
            color=INK,
        )  # fmt: skip
    ax.xaxis.set_major_formatter(lambda value, _: count(round(value)))
    ax.grid(False, axis="y")
    ax.set_xlabel("twice the gain of log-likelihood (fitted part)")
    legend(ax)
