"""Angle against its reference, with the error below."""

from typing import NamedTuple

import numpy as np

from estimator.spans import spans
from hil.numbers import COVERAGE, prefix_for, quantity, significant
from hil.records.estimates import Estimates
from hil.records.table import scored_from_s
from hil.report.material import Floats, Material
from hil.report.pixel_series import PixelSeries
from hil.report.theme import BAD, FIRST, INK, MUTED, SECOND, Drawing, fit_to, legend, span_time, stacked, trace

_RIVAL_SHOWN_WITHIN = 4.0
"""Integrated rate may stretch the scale of the angle error by this much, and leaves the panel beyond."""
_ANGLE, _LOWER, _UPPER, _INVALID, _EXPANDED = range(5)
"""Series of the panel above."""


class _Curve(NamedTuple):
    name: str
    column: str
    colour: str


_REPORTED = _Curve("reported angle φ", "angle_rad", FIRST)
_INTEGRATED = _Curve("integrated rate ∫Ω dt", "angle_rate_integral_rad", SECOND)
_PLAIN = _Curve("plain formula (11)", "angle_plain_rad", MUTED)


def angle_figure(material: Material) -> Drawing | None:
    """Reported angle φ, its reference, and their difference; without a reference, φ beside its two rivals."""
    estimates, reference = material.estimates, material.reference
    if estimates is None or "angle_rad" not in estimates:
        return None
    zero = _zero(estimates)
    whole = material.drawn(lambda part: _series(material, part, zero))
    if not np.isfinite(whole.low[:, _ANGLE]).any():
        return None
    curves = (_PLAIN, _INTEGRATED) if reference is None else (_REPORTED, _INTEGRATED)
    apart = _differences(material, curves)
    span = estimates.ends_s
    figure, (above, below) = stacked(3.9, (1.2, 1.0))
    if reference is not None:
        above.plot(*apart.line(len(curves)), color=INK, linewidth=4, alpha=0.22, label=reference.name)
    above.plot(*whole.line(_ANGLE), color=FIRST, label="reported angle φ")
    # A plug-in may leave its uncertainty out.
    expanded = "angle_u_rad" in estimates and bool(np.isfinite(whole.high[:, _EXPANDED]).any())
    if expanded:
        above.fill_between(*whole.band(_LOWER, _UPPER), color=FIRST, alpha=0.18, linewidth=0)
    above.set_ylabel("angle / rad")
    invalid = whole.high[:, _INVALID] > 0
    for start, stop in spans(invalid):
        above.axvspan(whole.t_s[start], whole.t_s[stop - 1], ymax=0.035, color=BAD, linewidth=0)
    legend(above)
    against = "φ" if reference is None else reference.name
    sizes = [apart.held.size(k) for k in range(len(curves))]
    crowding = reference is not None and sizes[1] > _RIVAL_SHOWN_WITHIN * sizes[0]
    fitted = range(1 if crowding else len(curves))
    factor, prefix = prefix_for(max(sizes[k] for k in fitted), 0)
    for k, curve in reversed(list(enumerate(curves))):
        trace(below, apart, k, curve.colour, curve.name, factor)
    if expanded:
        t, _, edge = whole.band(_EXPANDED, _EXPANDED, factor)
        below.fill_between(t, -edge, edge, color=FIRST, alpha=0.12, linewidth=0, label="± U (k = 2)")
    below.set_ylabel(f"minus {against} / {prefix}rad")
    fit_to(below, np.array([end for k in fitted for end in (apart.held.low[k], apart.held.high[k])]) * factor)
    legend(below)
    span_time([above, below], span, material.settle_s)
    figures = "; ".join(
        f"{curve.name} {quantity(float(rms), 'rad')} rms" for curve, rms in zip(curves, apart.held.rms, strict=False)
    )
    caption = f"Above, the angle; below, the difference from {against}; both zero where scoring starts: {figures}."
    if expanded:
        caption += " Bands: the expanded uncertainty (k = 2) since scoring starts."
    if invalid.any():
        caption += " Red along the axis: the quadrature was too large, so the angle is not valid."
    ends = [float(estimates.part(row, row + 1)["angle_rad"][0]) for row in (0, len(estimates) - 1)]
    runs = f"from {significant(ends[0], 4)} to {significant(ends[1], 4)} rad over {span[1] - span[0]:.4g} seconds"
    alt = f"Two panels over time. The reported angle runs {runs}. Difference from {against}: {figures}."
    return Drawing(figure, "Angle", caption, alt)


class _Zero(NamedTuple):
    """Where the angles begin to count anew: bench time, and the angle in rad that was counted until then."""

    t_s: float
    turn_rad: float


def _zero(estimates: Estimates) -> _Zero:
    """The new zero of the angles; none before the first row where they have one zero only."""
    at = scored_from_s(estimates.ends_s[0], estimates.header.get("angle_zero_after_s", 0.0), estimates.tick_rate_Hz)
    first = len(estimates) - len(estimates.since(at))
    if not 1 < first < len(estimates):
        return _Zero(0.0, 0.0)
    earlier, last = estimates.part(first - 2, first)["angle_rad"]
    turn = 2.0 * last - earlier
    return _Zero(at, float(turn) if np.isfinite(turn) else 0.0)


def _series(material: Material, part: Estimates, zero: _Zero) -> list[Floats]:
    """Angle, the ends of its band, whether it means nothing, and half the band, of a part of the estimates (n,)."""
    angle, half = part["angle_rad"] - np.where(part.t_s < zero.t_s, zero.turn_rad, 0.0), np.zeros(len(part))
    if "angle_u_rad" in part:  # of the angle's change since scoring starts: 0 before
        u = part["angle_u_rad"]
        half = COVERAGE * np.where((part.t_s >= material.settle_s) & np.isfinite(u), u, 0.0)
    return [angle, angle - half, angle + half, np.where(part.valid, 0.0, 1.0), half]


def _differences(material: Material, curves: tuple[_Curve, ...]) -> PixelSeries:
    """Differences of some curves in rad, zero where scoring starts, and behind them the reference itself, put where
    the reported angle is there."""

    reference = material.reference
    differences = material.from_zero(
        reference, lambda part: [part.estimated(curve.column) - part.angle_rad for curve in curves]
    )
    (apart,) = material.at_first(reference, lambda part: [part.estimated("angle_rad") - part.angle_rad])
    return material.compared(reference, lambda part: [*differences(part), part.angle_rad + apart])
