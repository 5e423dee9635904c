"""Rate with its 95 % band, and its error where a reference exists."""

from typing import TYPE_CHECKING

import numpy as np

from hil.records.summary import SD_95
from hil.report import decimate
from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material, Reference
from hil.report.numbers import percent, prefix_for, quantity
from hil.report.theme import FIRST, INK, fit_to, legend, span_time, stacked, trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STEP = 2.0
"""The error's scale covers this many times its 99 % quantile: the instant after a step may run out of it."""


def draw(material: Material) -> Drawing | None:
    """Estimated rate beside its reference; below, their difference in the band the observer claims."""
    estimates, reference = material.estimates, material.reference
    if estimates is None or "rate_rad_s" not in estimates:
        return None
    t, scored = estimates.t_s, material.scored(estimates.t_s)
    rate, half = np.degrees(estimates["rate_rad_s"]), SD_95 * np.degrees(estimates.sd("rate_rad_s"))
    if reference is not None:
        figure, (above, below) = stacked(3.7, (1.2, 1.0))
        true = np.degrees(reference.rate_rad_s)
        line = decimate.line(t[reference.rows], true)
        above.plot(*line, color=INK, linewidth=4, alpha=0.22, label=reference.name)
        fit_to(above, rate[scored], true)
        caption = _draw_error(below, material, reference, rate[reference.rows] - true, half[reference.rows])
        span_time([above, below], t, material.settle_s)
    else:
        figure, (above,) = stacked(2.3, (1.0,))
        above.fill_between(*decimate.band(t, rate - half, rate + half), color=FIRST, alpha=0.18, linewidth=0)
        fit_to(above, (rate - half)[scored], (rate + half)[scored])
        span_time([above], t, material.settle_s)
        caption = "Estimated rate; the band is the observer's 95 %."
    above.plot(*decimate.line(t, rate), color=FIRST, label="estimated rate Ω")
    above.set_ylabel("rate / (deg/s)")
    legend(above)
    low, high = rate[scored].min(), rate[scored].max()
    alt = f"Rate over time, between {low:.4g} and {high:.4g} degrees per second. {caption}"
    return Drawing(figure, "Rate", caption, alt)


def _draw_error(ax: "Axes", material: Material, reference: Reference, error: Floats, half: Floats) -> str:
    """The error (m,) in deg/s at the reference's rows, and its claimed half width; returns the caption."""
    assert material.estimates is not None
    t = material.estimates.t_s[reference.rows]
    scored = material.scored(t)
    size = np.abs(error[scored])
    largest, reach = float(size.max()), max(_STEP * float(np.quantile(size, 0.99)), float(half[scored].max()))
    factor, prefix = prefix_for(min(largest, reach))
    for edge, label in ((-half, ""), (half, "claimed 95 % band")):
        ax.plot(*decimate.line(t, edge * factor), color=INK, linewidth=0.8, dashes=(4, 3), label=label)
    trace(ax, t, error * factor, FIRST, "estimate")
    ax.set_ylabel(f"minus {reference.name} / ({prefix}deg/s)")
    fit_to(ax, np.clip(error[scored], -reach, reach) * factor, half[scored] * factor, -half[scored] * factor)
    legend(ax)
    rms, held = float(np.sqrt(np.mean(size**2))), float(np.mean(size <= half[scored]))
    caption = (
        f"Above, the rate; below, the difference from {reference.name}: {quantity(rms, 'deg/s')} rms, "
        f"{percent(held)} of it inside the band the observer claims (95 % expected)."
    )
    beyond = f" The largest, {quantity(largest, 'deg/s')}, runs out of the panel."
    return caption + beyond if largest > reach else caption
