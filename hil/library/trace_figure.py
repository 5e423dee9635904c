"""A trace in one figure, for a notebook; the report has more."""

from typing import TYPE_CHECKING, Any

from hil.records.diagnosis import Diagnosis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 10


def trace_figure(diagnosis: Diagnosis) -> "Figure":
    """Left: innovation over its floor, held out, before and after.  Right: evidence, named effects first, then
    what was carried beside them, then what a scan promises of the others."""
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
    """What a model gained that carries it is no promise of a scan: those are hatched."""
    groups: tuple[tuple[str, list[tuple[str, float | None]], dict[str, Any]], ...] = (
        ("named", [(effect.name, effect.evidence) for effect in diagnosis.effects], {"color": "tab:blue"}),
        ("fitted, not named", [(one.name, one.gain) for one in diagnosis.rejected], {"color": "tab:gray"}),
        (
            "promised by the scan",
            [(one.name, one.evidence) for one in diagnosis.rejected if one.gain is None],
            {"facecolor": "none", "edgecolor": "tab:gray", "hatch": "/////"},
        ),
    )
    known = [(name, value, at) for at, (_, ones, _) in enumerate(groups) for name, value in ones if value and value > 0]
    shown = known[:_MOST][::-1]
    for at, (label, _, look) in enumerate(groups):
        ours = [(row, name, value) for row, (name, value, group) in enumerate(shown) if group == at]
        if ours:
            ax.barh([row for row, _, _ in ours], [value for *_, value in ours], label=label, **look)
    ax.set_yticks(range(len(shown)), [name for name, _, _ in shown])
    if shown:
        ax.set_xscale("log")
        ax.legend(fontsize="small")
    ax.set_xlabel("twice the gain of log-likelihood")
