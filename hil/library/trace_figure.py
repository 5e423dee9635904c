"""A trace in one figure, for a notebook; the report has more."""

from typing import TYPE_CHECKING

from hil.records.diagnosis import Diagnosis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 10


def draw(diagnosis: Diagnosis) -> "Figure":
    """Left: innovation over its floor, held out, before and after.  Right: evidence, named effects first."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    level, evidence = figure.subplots(1, 2, width_ratios=(1, 2))
    _draw_level(level, diagnosis)
    _draw_evidence(evidence, diagnosis)
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


def _draw_evidence(ax: "Axes", diagnosis: Diagnosis) -> None:
    named = [(effect.name, effect.evidence, "tab:blue") for effect in diagnosis.effects]
    others = [(one.name, one.evidence, "tab:gray") for one in diagnosis.rejected]
    known = [(name, value, colour) for name, value, colour in named + others if value is not None and value > 0.0]
    shown = known[:_MOST][::-1]
    ax.barh([name for name, _, _ in shown], [v for _, v, _ in shown], color=[colour for _, _, colour in shown])
    if shown:
        ax.set_xscale("log")
    ax.set_xlabel("twice the gain of log-likelihood (blue: named)")
