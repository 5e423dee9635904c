"""A few cycles of what was measured, with what the model made of them on top and what it leaves below."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hil.numbers import prefix_for, sensed
from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material
from hil.report.theme import FIRST, INK, MUTED, legend, new_figure

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
    """Samples to show where a cycle has so many."""
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
    factors = [_factor(float(np.max(np.abs(measured), initial=0.0)), unit), _factor(largest, unit)]
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


def _factor(size: float, unit: str) -> tuple[float, str]:
    """Volts with a prefix; a sensor's own unit as it is."""
    factor, prefix = prefix_for(size) if unit == "V" else (1.0, "")
    return factor, prefix + unit
