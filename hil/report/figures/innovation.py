"""Innovation over time, in the band a complete model would keep to."""

import numpy as np

from hil.records.innovation import Innovation
from hil.records.summary import SD_95
from hil.report import decimate
from hil.report.figures.drawing import Drawing
from hil.report.material import Material
from hil.report.numbers import percent, prefix_for, quantity
from hil.report.theme import AXIS_COLOURS, INK, fit_to, span_time, stacked


def draw(material: Material) -> Drawing | None:
    """Envelope of the innovation, a panel per axis, with ± 1.96 predicted standard deviations."""
    innovation = material.innovation
    if innovation is None:
        return None
    scored = _Scored(material.scored_innovation(innovation))
    factor, prefix = prefix_for(scored.largest)
    figure, panels = stacked(0.6 + 1.25 * innovation.axes, (1.0,) * innovation.axes)
    axes = innovation.axes
    parts = ((piece.t_s, np.hstack([piece.nu_V, SD_95 * piece.sd_V])) for piece in innovation.pieces())
    middle, low, high = decimate.envelopes(parts, len(innovation))
    words = []
    for axis, ax in enumerate(panels):
        ax.fill_between(
            middle, low[:, axis] * factor, high[:, axis] * factor, color=AXIS_COLOURS[axis], alpha=0.45, linewidth=0.4
        )
        edge = decimate.zigzag(middle, low[:, axes + axis] * factor, high[:, axes + axis] * factor)
        for sign in (-1, 1):
            ax.plot(edge[0], sign * edge[1], color=INK, linewidth=0.8, dashes=(4, 3))
        fit_to(ax, scored.span[axis] * factor)
        ax.set_ylabel(f"ν{'xy'[axis]} / {prefix}V")
        held, rms = scored.held[axis] / scored.count, float(np.sqrt(scored.squares[axis] / scored.count))
        words.append(f"{'xy'[axis]} {quantity(rms, 'V')} rms, {percent(held)} inside")
    t = np.array([innovation.part(0, 1).t_s[0], innovation.part(len(innovation) - 1, len(innovation)).t_s[0]])
    span_time(panels, t, material.settle_s)
    caption = (
        f"Measured minus predicted voltage: {'; '.join(words)} (95 % expected). "
        "Filled: smallest to largest; dashed: ± 1.96 predicted standard deviations."
    )
    return Drawing(figure, "Innovation in time", caption, f"Innovation over time. {caption}")


class _Scored:
    """What the scored window holds, per axis."""

    def __init__(self, innovation: Innovation) -> None:
        axes = innovation.axes
        self.count = len(innovation)
        self.squares, self.held, self.largest = np.zeros(axes), np.zeros(axes), 0.0
        self.span = np.full((axes, 2), np.nan)
        """Smallest and largest of innovation and band."""
        for piece in innovation.pieces():
            nu, half = piece.nu_V, SD_95 * piece.sd_V
            self.squares += np.sum(nu**2, axis=0)
            self.held += np.count_nonzero(np.abs(nu) <= half, axis=0)
            self.largest = float(np.fmax(self.largest, np.abs(nu).max()))
            finite = np.vstack([np.where(np.isfinite(nu), nu, np.nan), np.where(np.isfinite(half), half, np.nan)])
            self.span[:, 0] = np.fmin(self.span[:, 0], np.fmin.reduce(finite))
            self.span[:, 1] = np.fmax(self.span[:, 1], np.fmax.reduce(finite))
