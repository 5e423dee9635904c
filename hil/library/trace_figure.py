"""A trace in one figure, for a notebook; the report has more."""

from typing import TYPE_CHECKING

from hil.records.diagnosis import Diagnosis
from hil.report.diagnosis.evidence import bars_of, draw_bars

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def trace_figure(diagnosis: Diagnosis) -> "Figure":
    """Left: innovation over its floor, held out, before and after.  Right: evidence, named effects first, then
    other fitted candidates, then what a score test predicts for the rest."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    level, evidence = figure.subplots(1, 2, width_ratios=(1, 2))
    _draw_level(level, diagnosis)
    if bars := bars_of(diagnosis):
        draw_bars(evidence, bars)
    figure.suptitle(f"{diagnosis.record}: {diagnosis.verdict}")
    return figure


def _draw_level(ax: "Axes", diagnosis: Diagnosis) -> None:
    held = (("before", diagnosis.held_out.before.ratio), ("after", diagnosis.held_out.after.ratio))
    known = [(word, ratio) for word, ratio in held if ratio is not None]
    bars = ax.bar([word for word, _ in known], [ratio for _, ratio in known], color="tab:gray")
    ax.bar_label(bars, fmt="%.3g")
    ax.axhline(1.0, color="black", linewidth=0.8)
    ax.set_yscale("log")
    ax.set_ylabel("innovation over its floor, held out")
