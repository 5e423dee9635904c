"""The residual over time, before and after, as multiples of the noise floor."""

import numpy as np

from hil.numbers import significant
from hil.report.diagnosis.material import Material
from hil.report.figures.drawing import Drawing
from hil.report.theme import FIRST, INK, MUTED, SECOND, legend, new_figure, plain_log_ticks, span_time

_WINDOWS = 240


def residual_level_figure(material: Material) -> Drawing | None:
    """rms over short windows, all axes together, on a logarithmic scale; the part held out is shaded."""
    found = material.found
    samples = len(found.residual_before)
    size = max(samples // _WINDOWS, 8)
    windows = samples // size
    if windows < 8:
        return None
    floor = np.array(found.held_out_after.noise_floor)
    time = material.record.time
    middle = time[: windows * size].reshape(windows, size).mean(axis=1)
    figure = new_figure(2.3)
    ax = figure.subplots()
    drawn = [(found.residual_before, FIRST, "residual")]
    if material.changed:
        drawn = [(found.residual_before, SECOND, "before"), (found.residual_after, FIRST, "after")]
    shown = []
    for residual, colour, name in drawn:
        scaled = (residual / floor)[: windows * size].reshape(windows, -1)
        valid = np.isfinite(scaled)
        count = np.maximum(valid.sum(axis=1), 1)
        level = np.sqrt((np.where(valid, scaled, 0.0) ** 2).sum(axis=1) / count)
        level[valid.sum(axis=1) == 0] = np.nan
        ax.semilogy(middle, level, color=colour, label=name)
        shown.append(level[np.isfinite(level) & (middle >= time[material.settled])])
    ax.axhline(1.0, color=INK, linewidth=0.9, dashes=(4, 3), label="noise floor")
    span_time([ax], time)
    start = float(time[min(found.split, samples - 1)])
    ax.axvspan(start, float(time[-1]), color=MUTED, alpha=0.10, linewidth=0)
    ax.annotate(
        "held out", (start, 0.0), xycoords=ax.get_xaxis_transform(), xytext=(5, 5), textcoords="offset points",
        color=MUTED, fontsize=8,
    )  # fmt: skip
    every = np.concatenate(shown)
    if every.size:
        ax.set_ylim(min(0.8, every.min() / 1.2), max(1.5, every.max() * 1.3))
    plain_log_ticks(ax.yaxis)
    ax.set_xlabel("time / s")
    ax.set_ylabel("rms / floor")
    legend(ax)
    before, after = found.held_out_before.ratio, found.held_out_after.ratio
    caption = f"On the held-out part (shaded) the residual is {significant(before)} × the floor"
    caption += f" before and {significant(after)} × after." if material.changed else "."
    return Drawing(figure, "Residual over time", caption, f"rms over windows of {size} samples. {caption}")
