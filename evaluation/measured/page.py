"""evaluation/results/measured.md and its figures, from the outcomes of a run."""

from collections.abc import Sequence
from pathlib import Path

from evaluation.measured.outcome import Outcome, Panel
from hil.records.atomic import write_text
from hil.report import theme

_INTRODUCTION = """\
# Measured records

Real oscillators and gyros, measured by others, through the same model, observer and tracing as a record of the bench.
Every error is on a part of the record, or a second record, that no coefficient was fitted to and no effect was chosen
on; on the rate table it has a veto, a term that makes it worse is taken back. Made by `make measured`, with the
figures; the records themselves stay with their owners. The time is that of a whole record, on the wall.
"""
_COLUMNS = ("record", "split", "error", "before", "after", "verdict", "what was missing", "time, s")


def write_page(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Write the page at `path` and an SVG beside it for each panel."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [_INTRODUCTION, "| " + " | ".join(_COLUMNS) + " |", "|" + "---|" * len(_COLUMNS)]
    rows = [(one.seconds, place, row) for one in outcomes for place, row in enumerate(one.rows)]
    for seconds, place, row in rows:
        taken = f"{seconds:.0f}" if place == 0 else ""
        error = f"{row.metric}, {row.unit}"
        effects = ", ".join(row.effects) or "–"
        cells = (row.record, row.split, error, f"{row.before:.4g}", f"{row.after:.4g}", row.verdict, effects, taken)
        lines.append("| " + " | ".join(cells) + " |")
    for outcome in outcomes:
        lines.append(f"\n## {outcome.title}")
        lines += [f"\n{paragraph}" for paragraph in outcome.paragraphs]
        for panel in outcome.panels:
            write_panel(path.parent / f"measured-{panel.name}.svg", panel)
            lines.append(f"\n![{panel.title}](measured-{panel.name}.svg)")
    write_text(path, "\n".join(lines) + "\n")


def write_panel(path: Path, panel: Panel) -> None:
    """One figure as SVG on white, the same bytes for the same numbers."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    colours = (theme.MUTED, theme.SECOND, theme.FIRST)[-len(panel.curves) :]
    with plt.rc_context({"svg.hashsalt": "hil", "svg.fonttype": "none", "font.size": 8.5}):
        figure, axes = plt.subplots(figsize=(theme.WIDTH_IN, 2.8), layout="constrained")
        every = max(1, len(panel.x) // 4000)
        for (label, series), colour in zip(panel.curves, colours, strict=True):
            axes.plot(panel.x[::every], series[::every], color=colour, linewidth=0.7, label=label)
        if panel.logarithmic:
            axes.set_yscale("log")
        axes.set_title(panel.title, loc="left", fontsize=8.5)
        axes.set_xlabel(panel.x_label)
        axes.set_ylabel(panel.y_label)
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False)
        figure.savefig(path, metadata={"Date": None, "Creator": None}, facecolor="white")
        plt.close(figure)
