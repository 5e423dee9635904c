"""Rate with its 95 % band, and its error where a reference exists."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from hil.numbers import SD_95, percent, prefix_for, quantity
from hil.records.estimates import Estimates
from hil.records.rate_reference import Compared
from hil.report.material import Floats, Material, Reference
from hil.report.pixel_series import PixelSeries, spread
from hil.report.theme import FIRST, INK, Drawing, fit_to, legend, span_time, stacked, trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STEP = 2.0
"""The error's scale covers this many times its 99 % quantile: the instant after a step may run out of it."""
_RATE, _LOWER, _UPPER = range(3)
_ERROR, _HALF, _INSIDE, _TRUE = range(4)


def rate_figure(material: Material) -> Drawing | None:
    """Estimated rate beside its reference; below, their difference in the band that the observer states."""
    estimates, reference = material.estimates, material.reference
    if estimates is None or "rate_rad_s" not in estimates:
        return None
    whole = material.drawn(_series)
    held, span = whole.held, estimates.ends_s
    if reference is not None:
        figure, (above, below) = stacked(3.7, (1.2, 1.0))
        beside = material.compared(reference, _errors)
        above.plot(*beside.line(_TRUE), color=INK, linewidth=4, alpha=0.22, label=reference.name)
        true = beside.low[:, _TRUE], beside.high[:, _TRUE]
        fit_to(above, held.low[[_RATE]], held.high[[_RATE]], *true)
        caption = _draw_error(below, material, reference, beside)
        span_time([above, below], span, material.settle_s)
    else:
        figure, (above,) = stacked(2.3, (1.0,))
        above.fill_between(*whole.band(_LOWER, _UPPER), color=FIRST, alpha=0.18, linewidth=0)
        fit_to(above, np.fmin(held.low[[_LOWER]], held.low[[_RATE]]), np.fmax(held.high[[_UPPER]], held.high[[_RATE]]))
        span_time([above], span, material.settle_s)
        given = bool(np.isfinite(held.high[_UPPER]))
        band = "the band is the observer's 95 %" if given else "its uncertainty is not given"
        caption = f"Estimated rate; {band}."
    above.plot(*whole.line(_RATE), color=FIRST, label="estimated rate Ω")
    above.set_ylabel("rate / (rad/s)")
    legend(above)
    low, high = held.low[_RATE], held.high[_RATE]
    alt = f"Rate over time, between {low:.4g} and {high:.4g} rad/s. {caption}"
    return Drawing(figure, "Rate", caption, alt)


def _series(part: Estimates) -> list[Floats]:
    rate, half = part["rate_rad_s"], SD_95 * part.sd("rate_rad_s")
    return [rate, rate - half, rate + half]


def _errors(part: Compared) -> list[Floats]:
    """Error, half of the stated band, whether the one is within the other, and the reference, in rad/s (n,)."""
    error = part.estimated("rate_rad_s") - part.rate_rad_s
    half = SD_95 * part.estimated("sd_rate_rad_s")
    return [error, half, (np.abs(error) <= half).astype(float), part.rate_rad_s]


def _draw_error(ax: "Axes", material: Material, reference: Reference, beside: PixelSeries) -> str:
    """The error in rad/s, and its stated half width; returns the caption."""
    held = beside.held

    def sizes() -> Iterator[Floats]:
        for part in reference.parts():
            error = np.abs(_errors(part)[_ERROR])
            yield error[np.isfinite(error) & (part.t_s >= material.settle_s)]

    assert material.estimates is not None
    size = spread(sizes, len(material.estimates))
    usual = float(np.quantile(size, 0.99)) if size.size else held.size(_ERROR)
    largest, reach = held.size(_ERROR), float(np.fmax(_STEP * usual, held.high[_HALF]))
    factor, prefix = prefix_for(min(largest, reach), 0)
    for sign, label in ((-1, ""), (1, "stated 95 % band")):
        edge = beside.line(_HALF, sign * factor)
        ax.plot(*edge, color=INK, linewidth=0.8, dashes=(4, 3), label=label)
    trace(ax, beside, _ERROR, FIRST, "estimate", factor)
    ax.set_ylabel(f"minus {reference.name} / ({prefix}rad/s)")
    ends = np.clip([held.low[_ERROR], held.high[_ERROR]], -reach, reach)
    fit_to(ax, np.array([*ends, -held.high[_HALF], held.high[_HALF]]) * factor)
    legend(ax)
    given = bool(np.isfinite(held.high[_HALF]))
    inside = f"{percent(float(held.mean[_INSIDE]))} of it inside the 95 % band of the observer"
    caption = (
        f"Above, the rate; below, the difference from {reference.name}: {quantity(float(held.rms[_ERROR]), 'rad/s')} "
        f"rms, {inside if given else 'whose uncertainty the observer has not given'}."
    )
    beyond = f" The largest, {quantity(largest, 'rad/s')}, runs out of the panel."
    return caption + beyond if largest > reach else caption
