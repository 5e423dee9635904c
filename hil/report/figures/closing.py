"""The angle's error without and with what a trace found, one run over the other."""

import numpy as np

from hil.numbers import prefix_for, quantity, significant
from hil.records.rate_reference import Compared
from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material
from hil.report.pixel_series import PixelSeries
from hil.report.theme import FIRST, INK, SECOND, fit_to, span_time, stacked, trace


def closing_figure(material: Material) -> Drawing | None:
    """Error of the reported angle of the earlier run above, of this one below, each on its own scale."""
    if material.earlier is None:
        return None
    runs = [_error(material.earlier), _error(material)]
    if runs[0] is None or runs[1] is None:
        return None
    figure, panels = stacked(3.4, (1.0, 1.0))
    words, sizes = [], []
    for ax, run, colour, name in zip(panels, runs, (SECOND, FIRST), ("before", "after"), strict=True):
        assert run is not None
        drawn, span = run
        size = float(drawn.held.rms[0])
        factor, prefix = prefix_for(drawn.held.size(0), 0)
        trace(ax, drawn, 0, colour, factor=factor)
        ax.axhline(0.0, color=INK, linewidth=0.6)
        ax.set_ylabel(f"{name} / {prefix}rad")
        fit_to(ax, np.array([drawn.held.low[0], drawn.held.high[0]]) * factor)
        words.append(f"{name} {quantity(size, 'rad')} rms")
        sizes.append(size)
        span_time([ax], span)
    caption = f"Reported angle minus the true rotation: {', '.join(words)}. Mind the scales: they differ "
    caption += f"{significant(sizes[0] / sizes[1], 2)}-fold in rms."
    return Drawing(figure, "Angle error before and after", caption, caption)


def _error(material: Material) -> tuple[PixelSeries, tuple[float, float]] | None:
    """The angle's error in rad, zero where scoring begins, and from when to when it is scored."""
    estimates, reference = material.estimates, material.reference
    if estimates is None or reference is None or "angle_rad" not in estimates:
        return None

    def difference(part: Compared) -> list[Floats]:
        return [part.estimated("angle_rad") - part.angle_rad]

    zero = material.at_first(reference, difference)
    drawn = material.compared(reference, lambda part: [difference(part)[0] - zero[0]])
    first, last = estimates.ends_s
    return drawn, (first if material.settle_s > last else max(first, material.settle_s), last)
