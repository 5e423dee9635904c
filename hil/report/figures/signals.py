"""What went over the wire: sensed voltages and drives, as envelopes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hil.numbers import SD_95, percent, prefix_for, quantity, sensed, significant, unit_for
from hil.records.rate_reference import Compared
from hil.report.material import Floats, Material
from hil.report.pixel_series import PixelSeries, pixel_series
from hil.report.theme import (
    AXIS_COLOURS,
    FIRST,
    INK,
    MUTED,
    SECOND,
    Drawing,
    fit_to,
    legend,
    new_figure,
    span_time,
    stacked,
    trace,
)

_DRIVE_UNITS = {"mps2": "m/s²", "N": "N", "V": "V"}


def signals_figure(material: Material) -> Drawing | None:
    """Smallest and largest value in each column of pixels, per axis."""
    capture = material.capture
    if capture is None:
        return None
    drives = [("drive", _DRIVE_UNITS[capture.drive_unit])] if capture.has_drive else []
    names = [("sensed", capture.sense_unit), *drives]
    figure = new_figure(0.5 + 1.2 * len(names))
    titles = "xy"[: capture.axes] if capture.carrier_Hz is None else ("x, X", "y, X", "x, Y", "y, Y")
    grid = figure.subplots(len(names), len(titles), sharex=True, sharey="row", squeeze=False)

    def parts() -> Iterator[tuple[Floats, Floats]]:
        for piece in capture.pieces():
            yield piece.t_s, np.hstack([piece.sense_V, piece.drive] if capture.has_drive else [piece.sense_V])

    span = capture.ends_s
    drawn = pixel_series(parts(), span, len(capture), -math.inf, 700 // len(titles))
    words = []
    for row, (panels, (name, unit)) in enumerate(zip(grid, names, strict=True)):
        columns = range(row * len(titles), (row + 1) * len(titles))
        size = max(drawn.held.size(column) for column in columns)
        factor, prefix = prefix_for(size)  # of a drive
        factor, label = unit_for(size, unit) if name == "sensed" else (factor, prefix + unit)
        for axis, (ax, column) in enumerate(zip(panels, columns, strict=True)):
            edges = drawn.band(column, column, factor)
            ax.fill_between(*edges, color=AXIS_COLOURS[axis % 2], alpha=0.5, linewidth=0.4)
            ax.set_title(f"{name} {titles[axis]}")
        panels[0].set_ylabel(label)
        rms = drawn.held.rms[list(columns)]
        words.append(f"{name} {' and '.join(significant(float(value)) for value in rms)} {unit} rms")
    for ax in grid[-1]:
        ax.set_xlabel("time / s")
    span_time(list(grid.ravel()), span)
    caption = f"Envelopes of every sample: {'; '.join(words)}."
    return Drawing(figure, "Signals", caption, f"Envelopes over time. {caption}")


def innovation_figure(material: Material) -> Drawing | None:
    """Envelope of the innovation, a panel per axis, with ± 1.96 predicted standard deviations."""
    innovation = material.innovation
    if innovation is None:
        return None
    axes = innovation.axes

    def parts() -> Iterator[tuple[Floats, Floats]]:
        for piece in innovation.pieces():
            nu, half = piece.nu_V, SD_95 * piece.sd_V
            yield piece.t_s, np.hstack([nu, half, np.abs(nu) <= half])

    span = innovation.ends_s
    drawn = pixel_series(parts(), span, len(innovation), material.settle_s)
    held = drawn.held
    factor, unit = unit_for(max(held.size(axis) for axis in range(axes)), innovation.unit)
    figure, panels = stacked(0.6 + 1.25 * axes, (1.0,) * axes)
    words = []
    for axis, ax in enumerate(panels):
        colour = AXIS_COLOURS[axis]
        ax.fill_between(*drawn.band(axis, axis, factor), color=colour, alpha=0.45, linewidth=0.4)
        for sign in (-1, 1):
            ax.plot(*drawn.line(axes + axis, sign * factor), color=INK, linewidth=0.8, dashes=(4, 3))
        ends = [held.low[axis], held.high[axis], held.low[axes + axis], held.high[axes + axis]]
        fit_to(ax, np.array(ends) * factor)
        ax.set_ylabel(f"ν{'xy'[axis]} / {unit}")
        rms, inside = float(held.rms[axis]), float(held.mean[2 * axes + axis])
        words.append(f"{'xy'[axis]} {sensed(rms, innovation.unit)} rms, {percent(inside)} inside")
    span_time(panels, span, material.settle_s)
    caption = (
        f"Measured minus predicted: {'; '.join(words)} (95 % expected). "
        "Filled: smallest to largest; dashed: ± 1.96 predicted standard deviations."
    )
    return Drawing(figure, "Innovation in time", caption, f"Innovation over time. {caption}")


def closing_figure(material: Material) -> Drawing | None:
    """Error of the reported angle of the earlier run above, of this one below, each on its own scale."""
    if material.earlier is None:
        return None
    runs = [_error(material.earlier), _error(material)]
    if runs[0] is None or runs[1] is None:
        return None
    figure, panels = stacked(3.4, (1.0, 1.0))
    words, sizes = [], []
    for ax, run, colour, name in zip(panels, runs, (SECOND, FIRST), ("before", "after"), strict=True):
        assert run is not None
        drawn, span = run
        size = float(drawn.held.rms[0])
        factor, prefix = prefix_for(drawn.held.size(0), 0)
        trace(ax, drawn, 0, colour, factor=factor)
        ax.axhline(0.0, color=INK, linewidth=0.6)
        ax.set_ylabel(f"{name} / {prefix}rad")
        fit_to(ax, np.array([drawn.held.low[0], drawn.held.high[0]]) * factor)
        words.append(f"{name} {quantity(size, 'rad')} rms")
        sizes.append(size)
        span_time([ax], span)
    caption = f"Reported angle minus the true rotation: {', '.join(words)}. Mind the scales: they differ "
    caption += f"{significant(sizes[0] / sizes[1], 2)}-fold in rms."
    return Drawing(figure, "Angle error before and after", caption, caption)


def _error(material: Material) -> tuple[PixelSeries, tuple[float, float]] | None:
    """The angle's error in rad, zero where scoring begins, and from when to when it is scored."""
    estimates, reference = material.estimates, material.reference
    if estimates is None or reference is None or "angle_rad" not in estimates:
        return None

    def difference(part: Compared) -> list[Floats]:
        return [part.estimated("angle_rad") - part.angle_rad]

    drawn = material.compared(reference, material.from_zero(reference, difference))
    first, last = estimates.ends_s
    return drawn, (first if material.settle_s > last else max(first, material.settle_s), last)


_CYCLES = 6.0
_FEWEST, _MOST = 40, 1200  # samples: fewer show no course, more than there are pixels none


@dataclass(frozen=True)
class Left:
    """What a model leaves of the measured: values (n, axes), its colour, and how it is called."""

    values: Floats
    colour: str
    name: str


def prediction_figure(material: Material) -> Drawing | None:
    """The last cycles of the run, predicted a sample ahead by the observer that ran in the loop; demodulated streams
    show no cycle.
    """
    capture, innovation, resonance = material.capture, material.innovation, material.resonance_Hz
    if capture is None or capture.carrier_Hz is not None or innovation is None or resonance is None:
        return None
    size = window(innovation.tick_rate_Hz / resonance)
    last = innovation.part(max(len(innovation) - size, 0), len(innovation))
    measured = capture.between(int(last.tick[0]), int(last.tick[-1]))
    _, ours, theirs = np.intersect1d(measured.tick, last.tick, assume_unique=True, return_indices=True)
    if ours.size < _FEWEST:
        return None
    left = [Left(last.nu_V[theirs], FIRST, "predicted")]
    return prediction_panels(
        measured.t_s[ours], measured.sense_V[ours], left, where="The end of the run", unit=innovation.unit, ahead=True
    )  # fmt: skip


def window(cycle: float) -> int:
    return int(np.clip(round(_CYCLES * cycle), _FEWEST, _MOST))


def prediction_panels(
    t_s: Floats, measured: Floats, left: Sequence[Left], *, where: str, unit: str, ahead: bool
) -> Drawing | None:
    """Measured (n, axes) and models of it over t_s (n,) above, what each leaves below; a column per axis.

    where: of which part of the record; unit: of what is sensed; ahead: whether a sample ahead is predicted, and not
    all of it simulated. None where nothing is finite.
    """
    finite = [np.isfinite(one.values) for one in left]
    if not any(rows.any() for rows in finite):
        return None
    axes = measured.shape[1]
    figure = new_figure(3.4)
    grid = figure.subplots(2, axes, sharex=True, sharey="row", squeeze=False, height_ratios=(1.3, 1.0))
    largest = max(float(np.max(np.abs(one.values[rows]))) for one, rows in zip(left, finite, strict=True) if rows.any())
    factors = [unit_for(float(np.max(np.abs(measured), initial=0.0)), unit), unit_for(largest, unit)]
    for axis, (above, below) in enumerate(grid.T):
        above.plot(t_s, measured[:, axis] * factors[0][0], ".", color=INK, markersize=3.5, label="measured", zorder=3)
        for one in left:
            above.plot(t_s, (measured - one.values)[:, axis] * factors[0][0], color=one.colour, label=one.name)
            below.plot(t_s, one.values[:, axis] * factors[1][0], color=one.colour, linewidth=0.9)
        below.axhline(0.0, color=MUTED, linewidth=0.6)
        below.set_xlabel("time / s")
        below.set_xlim(float(t_s[0]), float(t_s[-1]))
        below.locator_params(axis="x", nbins=5)
        if axes > 1:
            above.set_title("xy"[axis])
    word = "predicted" if ahead else "simulated"
    grid[0][0].set_ylabel(f"sensed / {factors[0][1]}")
    grid[1][0].set_ylabel(f"minus {word} / {factors[1][1]}")
    legend(grid[0][-1])
    sizes = [f"{sensed(float(np.sqrt(np.nanmean(one.values**2))), unit)} rms" for one in left]
    leaves = (
        sizes[0] if len(left) == 1 else ", ".join(f"{one.name} {size}" for one, size in zip(left, sizes, strict=True))
    )
    how = "one sample ahead, from all samples before it" if ahead else "by a free run, which uses only the drive"
    caption = (
        f"{where}: above, measured (points) and computed by the model (line{'s' * (len(left) > 1)}), {word} {how}; "
        f"below, measured minus {word}: {leaves}."
    )
    return Drawing(figure, f"Measured and {word}", caption, f"Two curves over time, and their difference. {caption}")
