"""Convergence of every constant: deviation from its truth or declared value, in the band of the observer."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hil.numbers import SD_95, in_thousands, plus_minus, prefix_for
from hil.records.estimates import Estimates
from hil.records.units import symbol_of
from hil.report.material import Floats, Material
from hil.report.pixel_series import PixelSeries
from hil.report.tables import rank, shown, shown_unit
from hil.report.theme import FIRST, INK, Drawing, fit_to, legend, new_figure, span_time, stacked, trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_MOVING = ("x_m", "vx_mps", "y_m", "vy_mps", "rate_rad_s")
_COLUMNS = 3
_PIXELS = 300
_VALUE, _LOWER, _UPPER = range(3)
_DIAGONALS = {"k": ("kxx_per_s2", "kyy_per_s2"), "d": ("dxx_per_s", "dyy_per_s")}


class _Panel(NamedTuple):
    """Course of a constant in `factor` times `unit`, and what zero means."""

    title: str
    drawn: PixelSeries
    factor: float
    unit: str
    zero: str | None
    last: tuple[float, float]
    """Deviation and half of its band at the end"""


def parameters_figure(material: Material) -> Drawing | None:
    """A small panel per constant; the last one's scale is set by the scored window."""
    estimates = material.estimates
    if estimates is None:
        return None
    told = material.result.parameters
    declared = {symbol for symbol, one in told.items() if one.declared}
    names = [name for name in estimates.states if name not in _MOVING and symbol_of(name) not in declared]
    ordered = sorted(names, key=lambda name: rank(symbol_of(name)))
    if not ordered:
        return None
    columns = min(_COLUMNS, len(ordered))
    rows = math.ceil(len(ordered) / columns)
    figure = new_figure(0.4 + 1.3 * rows)
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    cells: list[Axes] = list(grid.ravel())
    panels = [_panel(material, estimates, name) for name in ordered]
    for ax, panel in zip(cells, panels, strict=False):
        _draw_panel(ax, panel)
    span_time(cells[: len(panels)], estimates.ends_s, material.settle_s)
    for ax in cells[len(panels) :]:
        ax.set_axis_off()
    for ax in grid[-1, : len(panels) - (rows - 1) * columns]:
        ax.set_xlabel("time / s")
    zero = " or ".join(sorted({panel.zero for panel in panels if panel.zero is not None}, reverse=True))
    caption = f"{f'Deviation from {zero}. ' if zero else ''}Line: estimate, band: its 95 % interval{_unsaid(material)}."
    if zero and "kxy_per_s2" in estimates:
        caption += " Cross terms are counted in the mean of the diagonal ones."
    ends = "; ".join(f"{panel.title} {_ended(panel)} {panel.unit}" for panel in panels)
    return Drawing(figure, "Parameters", caption, f"One panel per constant over time. At the end: {ends}.")


def _unsaid(material: Material) -> str:
    without = any(one.half is None for one in material.result.parameters.values())
    return ", where the observer gives one" if without else ""


def _ended(panel: _Panel) -> str:
    if not all(map(math.isfinite, panel.last)):
        return "is not finite"
    return plus_minus(*panel.last)


def _settled_s(material: Material, estimates: Estimates) -> float:
    """The scored window without its first quarter: what the panels' scale is set by."""
    first, last = estimates.ends_s
    start = max(first, material.settle_s) if material.settle_s <= last else first
    return start + 0.25 * (last - start)


def _panel(material: Material, estimates: Estimates, name: str) -> _Panel:
    title = shown(symbol_of(name))
    known = material.constant(name)
    reference = 0.0 if known is None else known[0]
    scale = 1.0 if known is None else _scale(material, name, reference)

    def series(part: Estimates) -> list[Floats]:
        deviation, half = (part[name] - reference) / scale, SD_95 * np.nan_to_num(part.sd(name)) / scale
        return [deviation, deviation - half, deviation + half]

    drawn = material.drawn(series, since_s=_settled_s(material, estimates), columns=_PIXELS)
    value, low, high = (float(column[0]) for column in series(estimates.part(len(estimates) - 1, len(estimates))))
    if known is None:
        unit = estimates.unit(name)
        factor, prefix = prefix_for(abs(value)) if unit == "V" else in_thousands(value)
        unit, zero = (prefix + shown_unit(unit)).strip(), None
    else:
        size = float(np.fmax(abs(drawn.held.low[_LOWER]), abs(drawn.held.high[_UPPER])))
        factor, unit = (1e6, "ppm") if size < 1e-3 else (1e2, "%")
        zero = known[1]
    return _Panel(title, drawn, factor, unit, zero, (value * factor, (high - low) / 2 * factor))


def _scale(material: Material, name: str, reference: float) -> float:
    """The value itself on the diagonal; for a cross term, which may be zero, the mean of the diagonal."""
    diagonal = _DIAGONALS.get(name[0], ())
    if name in diagonal:
        return abs(reference) or 1.0
    found = [known[0] for other in diagonal if (known := material.constant(other)) is not None]
    return float(np.mean(found)) if found and np.mean(found) > 0 else abs(reference) or 1.0


def _draw_panel(ax: "Axes", panel: _Panel) -> None:
    drawn, factor = panel.drawn, panel.factor
    if panel.zero is not None:
        ax.axhline(0.0, color=INK, linewidth=0.7, dashes=(4, 3))
    ax.fill_between(*drawn.band(_LOWER, _UPPER, factor), color=FIRST, alpha=0.18, linewidth=0)
    trace(ax, drawn, _VALUE, FIRST, factor=factor)
    zero = np.zeros(1 if panel.zero is not None else 0)
    fit_to(ax, drawn.held.low[[_LOWER]] * factor, drawn.held.high[[_UPPER]] * factor, zero)
    ax.set_title(f"{panel.title} / {panel.unit}" if panel.unit else panel.title)
    ax.locator_params(axis="both", nbins=4)


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
