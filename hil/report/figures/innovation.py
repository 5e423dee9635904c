"""Innovation over time, in the band a complete model would keep to."""

from collections.abc import Iterator

import numpy as np

from hil.numbers import percent, sensed, unit_for
from hil.records.coverage import SD_95
from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material
from hil.report.pixel_series import pixel_series
from hil.report.theme import AXIS_COLOURS, INK, fit_to, span_time, stacked


def innovation_figure(material: Material) -> Drawing | None:
    """Envelope of the innovation, a panel per axis, with ± 1.96 predicted standard deviations."""
    innovation = material.innovation
    if innovation is None:
        return None
    axes = innovation.axes

    def parts() -> Iterator[tuple[Floats, Floats]]:
        for piece in innovation.pieces():
            nu, half = piece.nu_V, SD_95 * piece.sd_V
            yield piece.t_s, np.hstack([nu, half, np.abs(nu) <= half])

    last = len(innovation) - 1
    span = float(innovation.part(0, 1).t_s[0]), float(innovation.part(last, last + 1).t_s[0])
    drawn = pixel_series(parts(), span, len(innovation), material.settle_s)
    held = drawn.held
    factor, unit = unit_for(max(held.size(axis) for axis in range(axes)), innovation.unit)
    figure, panels = stacked(0.6 + 1.25 * axes, (1.0,) * axes)
    words = []
    for axis, ax in enumerate(panels):
        colour = AXIS_COLOURS[axis]
        ax.fill_between(*drawn.band(axis, axis, factor), color=colour, alpha=0.45, linewidth=0.4)
        for sign in (-1, 1):
            ax.plot(*drawn.line(axes + axis, sign * factor), color=INK, linewidth=0.8, dashes=(4, 3))
        ends = [held.low[axis], held.high[axis], held.low[axes + axis], held.high[axes + axis]]
        fit_to(ax, np.array(ends) * factor)
        ax.set_ylabel(f"ν{'xy'[axis]} / {unit}")
        rms, inside = float(held.rms[axis]), float(held.mean[2 * axes + axis])
        words.append(f"{'xy'[axis]} {sensed(rms, innovation.unit)} rms, {percent(inside)} inside")
    span_time(panels, span, material.settle_s)
    caption = (
        f"Measured minus predicted: {'; '.join(words)} (95 % expected). "
        "Filled: smallest to largest; dashed: ± 1.96 predicted standard deviations."
    )
    return Drawing(figure, "Innovation in time", caption, f"Innovation over time. {caption}")
