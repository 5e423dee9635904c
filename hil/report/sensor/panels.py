"""A small panel per axis, side by side, on one scale."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.allan.noise import FLOOR, TOLD_CLUSTERS
from hil.numbers import prefix_for, significant
from hil.report.figures.spectrum import amplitude_density
from hil.report.pixel_series import pixel_series
from hil.report.sensor.material import SensorMaterial
from hil.report.sensor.words import PER_HOUR, noise
from hil.report.theme import FIRST, INK, MUTED, SECOND, Drawing, new_figure, plain_log_ticks, span_time, stacked, trace

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from estimator.allan.noise import Noise


_MOST = 3


def side_by_side(names: list[str], height_in: float) -> "tuple[Figure, list[Axes]]":
    """A figure with a panel titled by each of `names`, at most three in a row, and their panels."""
    columns = min(len(names), _MOST)
    rows = -(-len(names) // columns)
    figure = new_figure(height_in * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    panels: list[Axes] = list(grid[: len(names)])
    for ax in grid[len(names) :]:
        ax.set_axis_off()
    for ax, name in zip(panels, names, strict=True):
        ax.set_title(name)
    return figure, panels


def legend_of_all(figure: "Figure", panels: "list[Axes]") -> None:
    """One legend above the panels for whatever is drawn in any of them."""
    named: dict[str, Artist] = {}
    for ax in panels:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    figure.legend(list(named.values()), list(named), loc="outside upper right", ncols=len(named))


def allan_figure(material: SensorMaterial) -> Drawing | None:
    """On logarithmic scales; the band is the 95 % interval, points with fewer than ten clusters are hollow."""
    curves = {axis: found for axis, found in material.noise.items() if _drawable(found)}
    if not curves:
        return None
    figure, panels = side_by_side([f"axis {axis}" for axis in curves], 2.9)
    for ax, found in zip(panels, curves.values(), strict=True):
        _panel(ax, found)
    longest = max(float(found.curve.tau_s[-1]) for found in curves.values())
    panels[0].set_xlim(0.7 / material.capture.tick_rate_Hz, 1.4 * longest)
    points = np.concatenate([found.curve.deviation * PER_HOUR for found in curves.values()])
    panels[0].set_ylim(0.5 * points.min(), 1.6 * points.max())
    for ax in panels:
        plain_log_ticks(ax.yaxis)
        ax.set_xlabel("cluster length τ / s")
    panels[0].set_ylabel("Allan deviation / (°/h)")
    legend_of_all(figure, panels)
    caption = (
        "Dots, overlapping Allan deviation; band, 95 %; hollow, fewer than ten clusters. "
        "The fit is the sum of the noise terms of IEEE Std 952-1997, dotted the white noise in it, N/√τ."
    )
    if any(found.bias_instability for found in curves.values()):
        caption += " The ring marks where the bias instability is read."
    alt = f"Allan deviation against cluster length, both logarithmic. {' '.join(noise(material))} {caption}"
    return Drawing(figure, "Allan deviation", caption, alt)


def _drawable(found: "Noise") -> bool:
    return len(found.curve) > 1 and bool((found.curve.deviation > 0).all())


def _panel(ax: "Axes", found: "Noise") -> None:
    curve = found.curve
    low, high = curve.interval(0.95)
    sure = curve.clusters >= TOLD_CLUSTERS
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.fill_between(curve.tau_s, low * PER_HOUR, high * PER_HOUR, color=FIRST, alpha=0.18, linewidth=0)
    dots: dict[str, Any] = {
        "linestyle": "none",
        "marker": "o",
        "markersize": 2.6,
        "color": FIRST,
        "markeredgewidth": 0.7,
    }
    ax.plot(curve.tau_s[sure], curve.deviation[sure] * PER_HOUR, label="record", **dots)
    ax.plot(curve.tau_s[~sure], curve.deviation[~sure] * PER_HOUR, markerfacecolor="none", **dots)
    if found.fit is None:
        return
    tau = np.geomspace(found.fit.from_s, curve.tau_s[-1], 120)
    ax.plot(tau, found.fit.deviation(tau) * PER_HOUR, color=INK, linewidth=0.9, label="fit")
    if "white" in found.readings:
        white = np.sqrt(found.fit.part("white", tau)) * PER_HOUR
        ax.plot(tau, white, color=MUTED, linewidth=0.9, dashes=(1, 2), label="white noise")
    if (read := found.bias_instability) is not None:
        ring: dict[str, Any] = {
            "linestyle": "none",
            "marker": "o",
            "markersize": 7.0,
            "color": SECOND,
            "markerfacecolor": "none",
        }
        ax.plot([read.tau_s], [read.value * FLOOR * PER_HOUR], label="bias instability", **ring)


_SHORTEST = 256


def rate_density_figure(material: SensorMaterial) -> Drawing | None:
    """Amplitude density by Welch's method, with what the angle random walk says it should be: √2 N, one-sided."""
    rows = material.unbroken
    if rows.stop - rows.start < _SHORTEST:
        return None
    rate_Hz = material.capture.tick_rate_Hz
    densities = {}
    for axis, rate in material.rates_rad_s.items():
        frequency, density = amplitude_density(np.degrees(rate[rows])[:, None], rate_Hz)
        if density.all():
            densities[axis] = density[:, 0]
    if not densities:
        return None
    factor, prefix = prefix_for(float(np.median(np.concatenate(list(densities.values())))))
    figure, panels = side_by_side([f"axis {axis}" for axis in densities], 2.4)
    peaks = []
    for ax, (axis, density) in zip(panels, densities.items(), strict=True):
        ax.loglog(frequency, density * factor, color=FIRST, linewidth=0.8, label="record")
        white = material.noise[axis].readings.get("white")
        if white is not None:
            floor = math.degrees(white.value) * math.sqrt(2.0) * factor
            ax.axhline(floor, color=INK, linewidth=0.9, dashes=(4, 3), label="by the Allan deviation")
        highest = int(np.argmax(density))
        peaks.append(f"{axis} highest at {significant(float(frequency[highest]))} Hz")
        ax.set_xlabel("frequency / Hz")
        ax.set_xlim(frequency[0], frequency[-1])
    for ax in panels:
        plain_log_ticks(ax.yaxis)
        plain_log_ticks(ax.xaxis)
    panels[0].set_ylabel(f"density / ({prefix}deg/s/√Hz)")
    legend_of_all(figure, panels)
    where = "the whole record" if not material.capture.gaps else "the longest stretch without a gap"
    caption = (
        f"Amplitude spectral density of {where} (Welch, the mean taken out). Dashed, the white noise that the Allan "
        "deviation gives, √2 N: two ways to one number. A line that stands out is vibration or rotation."
    )
    return Drawing(figure, "Spectrum", caption, f"Spectra: {', '.join(peaks)}. {caption}")


def sensor_rate_figure(material: SensorMaterial) -> Drawing | None:
    """A panel per axis: every sample's envelope, and the mean of what falls into a column."""
    t_s, rates = material.capture.t_s, material.rates_rad_s
    if t_s.size < 2 or not rates:
        return None
    figure, panels = stacked(0.5 + 1.25 * len(rates), (1.0,) * len(rates))
    for ax, (axis, rate) in zip(panels, rates.items(), strict=True):
        drawn = pixel_series([(t_s, np.degrees(rate)[:, None])], (t_s[0], t_s[-1]), t_s.size, t_s[0])
        factor, prefix = prefix_for(drawn.held.size(0))
        trace(ax, drawn, 0, FIRST, factor=factor)
        ax.margins(y=0.12)
        ax.set_ylabel(f"{axis} / ({prefix}deg/s)")
    span_time(panels, t_s)
    caption = "Each axis as sent. Pale, everything between the least and the most sample of a stretch; dark, its mean."
    said = [
        f"{axis} from {significant(float(np.degrees(rate.min())))} to {significant(float(np.degrees(rate.max())))}"
        for axis, rate in rates.items()
    ]
    return Drawing(figure, "Rate", caption, f"Rates over time in degrees per second: {', '.join(said)}. {caption}")
