"""Innovation over time, in the band a complete model would keep to."""

import numpy as np

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
    t, scored = innovation.t_s, material.scored(innovation.t_s)
    factor, prefix = prefix_for(float(np.abs(innovation.nu_V[scored]).max()))
    figure, panels = stacked(0.6 + 1.25 * innovation.axes, (1.0,) * innovation.axes)
    words = []
    for axis, ax in enumerate(panels):
        nu, half = innovation.nu_V[:, axis], SD_95 * innovation.sd_V[:, axis]
        middle, low, high = decimate.envelope(t, nu * factor)
        ax.fill_between(middle, low, high, color=AXIS_COLOURS[axis], alpha=0.45, linewidth=0.4)
        for sign in (-1, 1):
            ax.plot(*decimate.line(t, sign * half * factor), color=INK, linewidth=0.8, dashes=(4, 3))
        fit_to(ax, nu[scored] * factor, half[scored] * factor)
        ax.set_ylabel(f"ν{'xy'[axis]} / {prefix}V")
        held = float(np.mean(np.abs(nu[scored]) <= half[scored]))
        rms = float(np.sqrt(np.mean(nu[scored] ** 2)))
        words.append(f"{'xy'[axis]} {quantity(rms, 'V')} rms, {percent(held)} inside")
    span_time(panels, t, material.settle_s)
    caption = (
        f"Measured minus predicted voltage: {'; '.join(words)} (95 % expected). "
        "Filled: smallest to largest; dashed: ± 1.96 predicted standard deviations."
    )
    return Drawing(figure, "Innovation in time", caption, f"Innovation over time. {caption}")
