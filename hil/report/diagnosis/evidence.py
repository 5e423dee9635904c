"""How much each candidate would explain, beside what chance would."""

import math

import numpy as np

from hil.report.diagnosis.material import Material
from hil.report.figures.drawing import Drawing
from hil.report.numbers import count, significant
from hil.report.theme import FIRST, INK, MUTED, new_figure

_MOST = 14


def draw(material: Material) -> Drawing | None:
    """Horizontal bars of the gain in log-likelihood, effects that were taken first."""
    found = material.found
    taken = [(effect.name, effect.evidence, True) for effect in found.effects]
    others = [(one.name, one.evidence, False) for one in found.rejected if one.evidence is not None]
    entries = [entry for entry in (*taken, *sorted(others, key=lambda entry: -entry[1])) if math.isfinite(entry[1])]
    entries = entries[:_MOST]
    if len(entries) < 2:
        return None
    figure = new_figure(0.6 + 0.21 * len(entries))
    ax = figure.subplots()
    rows = np.arange(len(entries))[::-1]
    sizes = [max(value, 1.0) for _, value, _ in entries]
    ax.barh(rows, sizes, height=0.62, color=[FIRST if ours else MUTED for *_, ours in entries], alpha=0.8)
    ax.set_xscale("log")
    ax.set_xlim(1.0, 2.5 * max(sizes))
    ax.set_yticks(rows, [name.replace("_", " ") for name, *_ in entries])
    for row, size in zip(rows, sizes, strict=True):
        ax.annotate(
            significant(size),
            (size, row),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=INK,
        )
    ax.xaxis.set_major_formatter(lambda value, _: count(round(value)))
    ax.grid(False, axis="y")
    ax.set_xlabel("twice the gain of log-likelihood (fitted part)")
    caption = (
        "Blue: what was taken, carried by the observer. Grey: what each of the others would have explained by itself, "
        "before. Effects that look alike on this record explain alike, and chance gives a few units."
    )
    listed = ", ".join(f"{name} {significant(size)}" for (name, *_), size in zip(entries, sizes, strict=True))
    return Drawing(figure, "Evidence for the candidates", caption, f"Bars: {listed}.")
