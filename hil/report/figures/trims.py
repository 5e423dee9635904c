"""Voltages of the trim outputs over time."""

import numpy as np

from hil.report.figures.drawing import Drawing
from hil.report.material import Material
from hil.report.theme import legend, span_time, stacked


def trims_figure(material: Material) -> Drawing | None:
    """One line per output, held from change to change; None where nothing was trimmed."""
    trims, estimates = material.folder.trims, material.estimates
    if trims is None or not len(trims) or estimates is None:
        return None
    figure, (ax,) = stacked(2.3, (1.0,))
    _, end_s = estimates.ends_s
    t_s = np.append(trims.columns["acted_tick"] / trims.tick_rate_Hz, end_s)
    for one, volts in zip(trims.outputs, trims.volts.T, strict=True):
        ax.step(t_s, np.append(volts, volts[-1]), where="post", label=one["name"])
    ax.set_ylabel("voltage / V")
    span_time([ax], estimates.ends_s, material.settle_s)
    legend(ax)
    last = ", ".join(f"{one['name']} {volts:.3f} V" for one, volts in zip(trims.outputs, trims.volts[-1], strict=True))
    caption = f"Voltages that the trim outputs put out; at the end {last}."
    return Drawing(figure, "Trim voltages", caption, caption)
