"""The missing force over what it may depend on, as small multiples.

The missing force over what it may depend on: means of bins with a band.

What moves with the vibration (displacement, velocity, drive) is taken at every sample.  Over what moves slowly
(orientation, amplitude, time, temperature) the force of a cycle is zero in the mean whatever it is; there its parts in
step with displacement and with velocity are shown, over some cycles each, along the whole motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.chance import TWO_SIDED
from estimator.missing_force.result import MissingForce
from estimator.scaling import Array
from hil.numbers import prefix_for
from hil.report.diagnosis.material import Material
from hil.report.theme import FIRST, MUTED, SECOND, Drawing, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_BINS = 25
_FEWEST = 8  # samples, or stretches, of a bin
_INDEPENDENT = 16.0  # cycles after which errors of the force are taken for others
_STRETCH = 4.0  # cycles that a part in step is taken over
_EDGE = 0.002  # of the samples at either end that bins leave out


@dataclass(frozen=True, eq=False)
class Curve:
    """Means (bins,) of a force [m/s²] over a quantity, at the means of the quantity, and the 95 % band of the means."""

    at: Array
    mean: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves by name, over one quantity: its name and SI unit."""

    over: str
    unit: str
    curves: dict[str, Curve]


def fast(found: MissingForce, cycle: float) -> list[Panel]:
    """The force of each axis over its own displacement, velocity and drive; cycle: samples of one."""
    axes = "xy"[: found.force.shape[1]]
    panels = []
    for name, unit, series in (
        ("displacement", "m", found.position),
        ("velocity", "m/s", found.velocity),
        ("drive", "m/s²", found.drive),
    ):
        if not np.any(series):
            continue
        curves = {}
        for axis, letter in enumerate(axes):
            curve = _curve(
                series[:, axis], found.force[:, axis], found.there, float(found.deviation[axis]), _INDEPENDENT * cycle
            )
            if curve is not None:
                curves[letter] = curve
        panels.append(Panel(name, unit, curves))
    return panels


def slow(found: MissingForce, cycle: float) -> list[Panel]:
    """The parts in step with displacement and velocity over orientation, amplitude, time and temperature."""
    rows = max(int(_STRETCH * cycle), 1)
    count = len(found.time) // rows
    if count < 2 * _FEWEST:
        return []

    def means(series: Array) -> Array:
        return np.asarray(series[: count * rows].reshape(count, rows).mean(axis=1))

    there = means(found.there.astype(float)) == 1.0
    squares = [means(np.sum(series**2, axis=1)) for series in (found.position, found.velocity)]
    parts = {}
    for name, series, square in zip(
        ("displacement", "velocity"), (found.position, found.velocity), squares, strict=True
    ):
        product = means(np.sum(found.force * series, axis=1))
        parts[f"in step with {name}"] = product * np.sqrt(2.0 / np.maximum(square, np.finfo(float).tiny))
    over = [("amplitude", "m", np.sqrt(2.0 * squares[0])), ("time", "s", means(found.time))]
    if found.force.shape[1] == 2:
        over.insert(0, ("orientation", "°", _orientation(found, means)))
    if found.temperature is not None and np.ptp(found.temperature) > 0.0:
        over.append(("temperature", "°C", means(found.temperature)))
    deviation = float(np.sqrt(np.mean(found.deviation**2)))
    panels = []
    for name, unit, against in over:
        curves = {}
        for part, values in parts.items():
            curve = _curve(against, values, there, deviation, _INDEPENDENT / _STRETCH)
            if curve is not None:
                curves[part] = curve
        panels.append(Panel(name, unit, curves))
    return panels


def _orientation(found: MissingForce, means: object) -> Array:
    """Of the vibration's ellipse, degrees from 0 to 180."""
    assert callable(means)
    x, y = found.position.T
    vx, vy = found.velocity.T
    stiffness = float(np.mean(found.velocity**2) / max(np.mean(found.position**2), np.finfo(float).tiny))
    both = means(2.0 * (stiffness * x * y + vx * vy)), means(stiffness * (x**2 - y**2) + vx**2 - vy**2)
    return np.asarray(np.degrees(0.5 * np.arctan2(*both)) % 180.0)


def _curve(
    against: Array, values: Array, there: NDArray[np.bool_], deviation: float, independent: float
) -> Curve | None:
    """The band is of the mean: by the scatter within a bin and by the force's own uncertainty, of as many independent
    visits as there were stretches of `independent` rows in which the bin was visited.
    """
    rows = np.flatnonzero(there & np.isfinite(against) & np.isfinite(values))
    if len(rows) < 4 * _FEWEST:
        return None
    against, values = against[rows], values[rows]
    low, high = np.quantile(against, [_EDGE, 1.0 - _EDGE])
    if not high > low:
        return None
    bins = np.floor((against - low) / (high - low) * _BINS).astype(int)
    at, mean, half = [], [], []
    for one in range(_BINS):
        own = bins == one
        if np.count_nonzero(own) < _FEWEST:
            continue
        visits = len(np.unique((rows[own] / max(independent, 1.0)).astype(int)))
        at.append(float(np.mean(against[own])))
        mean.append(float(np.mean(values[own])))
        half.append(TWO_SIDED * float(np.sqrt((np.var(values[own]) + deviation**2) / visits)))
    if len(at) < 3:
        return None
    middle, wide = np.array(mean), np.array(half)
    return Curve(np.array(at), middle, middle - wide, middle + wide)


_ROW = 2.1
_ACROSS = 3
_PLAIN = ("°", "°C", "s")  # units that take no prefix


def draw_fast(material: Material) -> Drawing | None:
    """Over displacement, velocity and drive of each axis."""
    caption = (
        "The force per mass that the model lacks, without a name, over the displacement, velocity and drive of its own "
        "axis: means of bins, with the 95 % band of the mean, from scatter and from what is not known of the force. "
        "A straight line is left out: constants take it up. A force that is nothing lies on zero."
    )
    return _drawn(material, fast, "Missing force over the motion", caption)


def draw_slow(material: Material) -> Drawing | None:
    """Over orientation, amplitude, time and temperature."""
    caption = (
        "The parts of the missing force that keep step with displacement (as stiffness does) and with velocity (as "
        "damping does), over what moves slowly: a value per four cycles, means of bins with their 95 % band."
    )
    return _drawn(material, slow, "Missing force over what moves slowly", caption)


def _drawn(
    material: Material, panels_of: Callable[[MissingForce, float], list[Panel]], title: str, caption: str
) -> Drawing | None:
    if (found := material.missing_force) is None:
        return None
    cycle = material.sample_rate_Hz / material.resonance_Hz
    if not (panels := [panel for panel in panels_of(found, cycle) if panel.curves]):
        return None
    rows = -(-len(panels) // _ACROSS)
    across = min(len(panels), _ACROSS)
    figure = new_figure(_ROW * rows + 0.35)
    grid = figure.subplots(rows, across, sharey=True, squeeze=False)
    largest = max(float(np.max(np.abs([curve.low, curve.high]))) for panel in panels for curve in panel.curves.values())
    factor, prefix = prefix_for(largest)
    for ax, panel in zip(grid.ravel(), panels, strict=False):
        _panel(ax, panel, factor)
    for ax in grid.ravel()[len(panels) :]:
        ax.set_visible(False)
    for row in grid:
        row[0].set_ylabel(f"force / ({prefix}m/s²)")
    lines, names = grid[0][0].get_legend_handles_labels()
    figure.legend(lines, names, loc="outside upper right", ncols=2)  # wider than a panel
    return Drawing(figure, title, caption, f"Curves with bands. {caption}")


def _panel(ax: "Axes", panel: Panel, factor: float) -> None:
    spread = max(float(np.max(np.abs(curve.at))) for curve in panel.curves.values())
    across, prefix = (1.0, "") if panel.unit in _PLAIN else prefix_for(spread)
    ax.axhline(0.0, color=MUTED, linewidth=0.6)
    for (name, curve), colour in zip(panel.curves.items(), (FIRST, SECOND), strict=False):
        ax.fill_between(
            curve.at * across, curve.low * factor, curve.high * factor, color=colour, alpha=0.25, linewidth=0
        )
        ax.plot(curve.at * across, curve.mean * factor, color=colour, label=name)
    unit = f"{prefix}{panel.unit}"
    ax.set_xlabel(f"{panel.over} / {f'({unit})' if '/' in unit else unit}")
    ax.margins(x=0.03)
