"""Spectrum of the innovation: what the model has not explained stands above the noise floor."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from hil.numbers import quantity, unit_for
from hil.records.estimates import stretches, usual_sd_V
from hil.report.material import Floats, Material
from hil.report.theme import AXIS_COLOURS, INK, MUTED, Drawing, legend, mark, new_figure, plain_log_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LONGEST_SEGMENT, _SHORTEST_SEGMENT = 4096, 64
_MOST_LINES = 8
_STANDS_OUT = 2.0


def innovation_spectrum_figure(material: Material) -> Drawing | None:
    """Amplitude spectral density by Welch's method, with the noise floor and multiples of the resonance."""
    innovation = material.innovation
    if innovation is None:
        return None
    scored, rate_Hz = material.scored_innovation(innovation), innovation.tick_rate_Hz
    usual = usual_sd_V(scored)
    if usual is None or not usual.any():
        return None
    rows = _longest(stretches(scored, usual))
    if rows < _SHORTEST_SEGMENT:
        return None
    segment = min(_segment(len(scored)), 2 ** int(np.log2(rows)))
    frequency, density = amplitude_density_of(stretches(scored, usual), segment, rate_Hz)
    if not np.isfinite(density).all() or not density.all():
        return None
    floor = float(np.sqrt(np.mean(usual**2) * 2 / rate_Hz))
    factor, unit = unit_for(float(np.median(density)), innovation.unit)
    figure = new_figure(2.7)
    ax = figure.subplots()
    for axis, colour in zip(range(innovation.axes), AXIS_COLOURS, strict=False):
        ax.semilogy(frequency, density[:, axis] * factor, color=colour, linewidth=0.9, label=f"ν{'xy'[axis]}")
    ax.axhline(floor * factor, color=INK, linewidth=0.9, dashes=(4, 3), label="noise floor")
    caption = f"Amplitude spectral density of the scored window (Welch, {segment} samples a segment, gaps left out)."
    if material.resonance_Hz is not None:
        marked = mark_multiples(ax, material.resonance_Hz, rate_Hz / 2)
        high = [n for n in marked if _peak(frequency, density, n * material.resonance_Hz) > _STANDS_OUT * floor]
        where = f"At {', '.join(_multiple(n) for n in high)}" if high else "At none of them"
        stands = "the innovation stands" if high else "does the innovation stand"
        caption += f" Marked: multiples of the resonance f₀ = {quantity(material.resonance_Hz, 'Hz', 4)}."
        caption += f" {where} {stands} above twice the noise floor."
    _scale(ax, density * factor, floor * factor)
    ax.set_xlim(0, rate_Hz / 2)
    ax.set_xlabel("frequency / Hz")
    ax.set_ylabel(f"density / ({unit}/√Hz)")
    legend(ax)
    ratio = float(np.median(density)) / floor
    alt = f"Density from 0 to {rate_Hz / 2:g} hertz; its median is {ratio:.2f} times the floor. {caption}"
    return Drawing(figure, "Innovation spectrum", caption, alt)


def amplitude_density(values: Floats, rate_Hz: float) -> tuple[Floats, Floats]:
    """Frequencies (m,) and one-sided amplitude density (m, axes) per √Hz; white noise s gives s·√(2/rate)."""
    return amplitude_density_of([values], _segment(len(values)), rate_Hz)


def amplitude_density_of(parts: Iterable[Floats | None], segment: int, rate_Hz: float) -> tuple[Floats, Floats]:
    """The same of values that come in parts (n, axes): segments lie half over each other, across parts as well, but
    not across None, which is a gap.
    """
    from estimator.residual.averaged import power_density

    step = segment // 2
    left = np.empty((0, 0))
    total: Floats | None = None
    frequency, done = np.empty(0), 0
    for part in parts:
        if part is None:
            left = np.empty((0, 0))
            continue
        values = np.concatenate([left, part]) if left.size else part
        count = (len(values) - segment) // step + 1
        if count > 0:
            frequency, power = power_density(values[: segment + (count - 1) * step], rate_Hz, segment)
            total = count * power if total is None else total + count * power
            done += count
        left = values[max(count, 0) * step :].copy()
    assert total is not None
    return frequency[1:], np.sqrt(total[1:] / done)  # the bin at 0 has the mean taken out of it


def _longest(parts: Iterable[Floats | None]) -> int:
    """Rows of the longest stretch without a gap."""
    longest = rows = 0
    for part in parts:
        rows = 0 if part is None else rows + len(part)
        longest = max(longest, rows)
    return longest


def _segment(rows: int) -> int:
    """A quarter of the record at most, so that averaging steadies the curve enough to read a line in it."""
    quarter = max(rows // 4, _SHORTEST_SEGMENT)
    return int(min(_LONGEST_SEGMENT, 2 ** int(np.log2(quarter))))


def mark_multiples(ax: "Axes", resonance_Hz: float, highest_Hz: float, most: int = _MOST_LINES) -> list[int]:
    """Dotted lines at the multiples of a resonance below `highest_Hz`; returns which."""
    multiples = [n for n in range(1, most + 1) if n * resonance_Hz < highest_Hz]
    for n in multiples:
        mark(ax, n * resonance_Hz, _multiple(n), MUTED, (2, -8))
    return multiples


def _scale(ax: "Axes", density: Floats, floor: float) -> None:
    ax.set_ylim(min(density.min(), floor) / 1.5, max(density.max(), floor) * 2.2)
    plain_log_ticks(ax.yaxis)


def _multiple(n: int) -> str:
    return "f₀" if n == 1 else f"{n} f₀"


def _peak(frequency: Floats, density: Floats, at_Hz: float) -> float:
    near = np.argsort(np.abs(frequency - at_Hz))[:3]
    return float(density[near].max())
