"""Angle against its reference, with the error below."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.report import decimate
from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material
from hil.report.numbers import prefix_for, quantity
from hil.report.theme import BAD, FIRST, INK, MUTED, SECOND, fit_to, legend, span_time, stacked, trace

_RIVAL_SHOWN_WITHIN = 4.0
"""Integrated rate may stretch the scale of the angle error by this much, and leaves the panel beyond."""


class _Curve(NamedTuple):
    name: str
    difference_deg: Floats
    colour: str


def draw(material: Material) -> Drawing | None:
    """Reported angle φ, its reference, and their difference; without a reference, φ beside its two rivals."""
    estimates, reference = material.estimates, material.reference
    if estimates is None or "angle_rad" not in estimates:
        return None
    if not np.isfinite(estimates["angle_rad"]).any():
        return None
    t, angle = estimates.t_s, np.degrees(estimates["angle_rad"])
    figure, (above, below) = stacked(3.9, (1.2, 1.0))
    if reference is not None:
        first = _first(material, t[reference.rows])
        shown = np.degrees(reference.angle_rad - reference.angle_rad[first]) + angle[reference.rows[first]]
        above.plot(*decimate.line(t[reference.rows], shown), color=INK, linewidth=4, alpha=0.22, label=reference.name)
    above.plot(*decimate.line(t, angle), color=FIRST, label="reported angle φ")
    expanded = _expanded_deg(material)
    if expanded is not None:
        edges = decimate.band(t, angle - expanded, angle + expanded)
        above.fill_between(*edges, color=FIRST, alpha=0.18, linewidth=0)
    above.set_ylabel("angle / deg")
    for start, stop in _spans(~estimates.valid):
        above.axvspan(t[start], t[stop - 1], ymax=0.035, color=BAD, linewidth=0)
    legend(above)
    rows = np.arange(t.size) if reference is None else reference.rows
    against = "φ" if reference is None else reference.name
    curves, scored = _curves(material, rows), material.scored(t[rows])
    sizes = [float(np.abs(curve.difference_deg[scored]).max()) for curve in curves]
    crowding = reference is not None and sizes[1] > _RIVAL_SHOWN_WITHIN * sizes[0]
    fitted = curves[:1] if crowding else curves
    factor, prefix = prefix_for(max(sizes[: len(fitted)]))
    for curve in reversed(curves):
        trace(below, t[rows], curve.difference_deg * factor, curve.colour, curve.name)
    if expanded is not None:
        edges = decimate.band(t[rows], -expanded[rows] * factor, expanded[rows] * factor)
        below.fill_between(*edges, color=FIRST, alpha=0.12, linewidth=0, label="± U (k = 2)")
    below.set_ylabel(f"minus {against} / {prefix}deg")
    fit_to(below, *(curve.difference_deg[scored] * factor for curve in fitted))
    legend(below)
    span_time([above, below], t, material.settle_s)
    figures = "; ".join(f"{curve.name} {quantity(_rms(curve.difference_deg[scored]), 'deg')} rms" for curve in curves)
    caption = f"Above, the angle; below, the difference from {against}, zero where scoring starts: {figures}."
    if expanded is not None:
        caption += " Bands: the expanded uncertainty (k = 2) since scoring starts."
    if not estimates.valid.all():
        caption += " Red along the axis: the ellipse was too round for its angle to mean something."
    span = f"from {angle[0]:.4g} to {angle[-1]:.4g} degrees over {t[-1] - t[0]:.4g} seconds"
    alt = f"Two panels over time. The reported angle runs {span}. Difference from {against}: {figures}."
    return Drawing(figure, "Angle", caption, alt)


def _expanded_deg(material: Material) -> Floats | None:
    """Expanded uncertainty (n,) of the angle's change since scoring starts, 0 before; None where none was recorded."""
    estimates = material.estimates
    assert estimates is not None
    if "angle_u_rad" not in estimates:
        return None
    since = estimates.t_s >= material.settle_s
    return np.degrees(2.0 * np.where(since & np.isfinite(estimates["angle_u_rad"]), estimates["angle_u_rad"], 0.0))


def _curves(material: Material, rows: npt.NDArray[np.intp]) -> list[_Curve]:
    """Differences in degrees at `rows`, zero at the first scored one; the most interesting first."""
    estimates, reference = material.estimates, material.reference
    assert estimates is not None
    integrated = ("integrated rate ∫Ω dt", "angle_rate_integral_rad", SECOND)
    if reference is not None:
        zero, chosen = reference.angle_rad, [("reported angle φ", "angle_rad", FIRST), integrated]
    else:
        zero, chosen = estimates["angle_rad"], [("plain formula (11)", "angle_plain_rad", MUTED), integrated]
    first = _first(material, estimates.t_s[rows])
    differences = [(name, np.degrees(estimates[column][rows] - zero), colour) for name, column, colour in chosen]
    return [_Curve(name, difference - difference[first], colour) for name, difference, colour in differences]


def _first(material: Material, t_s: Floats) -> int:
    return int(np.argmax(material.scored(t_s)))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _spans(mask: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs of True as [start, stop)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
