"""Convergence of every constant: deviation from its truth or declared value, in the band the observer
claims."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.records.summary import SD_95
from hil.records.units import symbol_of
from hil.report import decimate
from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material
from hil.report.names import rank, shown, shown_unit
from hil.report.numbers import prefix_for
from hil.report.theme import FIRST, INK, fit_to, new_figure, span_time, trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Mask = npt.NDArray[np.bool_]

_MOVING = ("x_m", "vx_mps", "y_m", "vy_mps", "rate_rad_s")
_COLUMNS = 3
_DIAGONALS = {"k": ("kxx_per_s2", "kyy_per_s2"), "d": ("dxx_per_s", "dyy_per_s")}


class _Panel(NamedTuple):
    """Deviation (n,) and half width (n,) to draw, what they are counted in, and what zero means."""

    title: str
    deviation: Floats
    half: Floats
    unit: str
    zero: str | None


def draw(material: Material) -> Drawing | None:
    """A small panel per constant; the last one's scale is set by the scored window."""
    estimates = material.estimates
    if estimates is None:
        return None
    names = [name for name in estimates.states if name not in _MOVING]
    t = estimates.t_s
    settled = _settled(t, material.scored(t))
    ordered = sorted(names, key=lambda name: rank(symbol_of(name)))
    if not ordered:
        return None
    columns = min(_COLUMNS, len(ordered))
    rows = math.ceil(len(ordered) / columns)
    figure = new_figure(0.4 + 1.3 * rows)
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    cells: list[Axes] = list(grid.ravel())
    panels = []
    for ax, name in zip(cells, ordered, strict=False):
        panel = _panel(material, name, settled)
        _draw_panel(ax, panel, t, settled)
        # of a long record: its last row is all that is still needed
        panels.append(panel._replace(deviation=panel.deviation[-1:].copy(), half=panel.half[-1:].copy()))
    span_time(cells[: len(panels)], t, material.settle_s)
    for ax in cells[len(panels) :]:
        ax.set_axis_off()
    for ax in grid[-1, : len(panels) - (rows - 1) * columns]:
        ax.set_xlabel("time / s")
    zero = " or ".join(sorted({panel.zero for panel in panels if panel.zero is not None}, reverse=True))
    caption = f"{f'Deviation from {zero}. ' if zero else ''}Line: estimate, band: its 95 % interval."
    if zero and "kxy_per_s2" in estimates:
        caption += " Cross terms are counted in the mean of the diagonal ones."
    ends = "; ".join(f"{p.title} {p.deviation[-1]:.3g} ± {p.half[-1]:.2g} {p.unit}" for p in panels)
    return Drawing(figure, "Parameters", caption, f"One panel per constant over time. At the end: {ends}.")


def _settled(t: Floats, scored: Mask) -> Mask:
    """The scored window without its first quarter: what the panels' scale is set by."""
    first, last = float(t[scored][0]), float(t[-1])
    settled: Mask = scored & (t >= first + 0.25 * (last - first))
    return settled


def _panel(material: Material, name: str, settled: Mask) -> _Panel:
    estimates = material.estimates
    assert estimates is not None
    values, half = estimates[name], SD_95 * estimates.sd(name)
    title = shown(symbol_of(name))
    known = material.constant(name)
    if known is None:
        unit = estimates.unit(name)
        factor, prefix = prefix_for(float(np.abs(values[-1]))) if unit == "V" else (1.0, "")
        return _Panel(title, values * factor, half * factor, prefix + shown_unit(unit), None)
    reference, kind = known
    scale = _scale(material, name, reference)
    deviation, spread = (values - reference) / scale, half / scale
    size = float(np.max(np.abs(deviation[settled]) + spread[settled]))
    factor, unit = (1e2, "%") if size >= 1e-3 else (1e6, "ppm")
    return _Panel(title, deviation * factor, spread * factor, unit, kind)


def _scale(material: Material, name: str, reference: float) -> float:
    """The value itself on the diagonal; for a cross term, which may be zero, the mean of the diagonal."""
    diagonal = _DIAGONALS.get(name[0], ())
    if name in diagonal:
        return abs(reference) or 1.0
    found = [known[0] for other in diagonal if (known := material.constant(other)) is not None]
    return float(np.mean(found)) if found and np.mean(found) > 0 else abs(reference) or 1.0


def _draw_panel(ax: "Axes", panel: _Panel, t: Floats, settled: Mask) -> None:
    low, high = panel.deviation - panel.half, panel.deviation + panel.half
    if panel.zero is not None:
        ax.axhline(0.0, color=INK, linewidth=0.7, dashes=(4, 3))
    ax.fill_between(*decimate.band(t, low, high, 300), color=FIRST, alpha=0.18, linewidth=0)
    trace(ax, t, panel.deviation, FIRST)
    zero = np.zeros(1 if panel.zero is not None else 0)
    fit_to(ax, low[settled], high[settled], zero)
    ax.set_title(f"{panel.title} / {panel.unit}" if panel.unit else panel.title)
    ax.locator_params(axis="both", nbins=4)
