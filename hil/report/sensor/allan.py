"""Allan deviation of each axis, with the noise that was fitted to it."""

from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.allan.noise import FLOOR, TOLD_CLUSTERS
from hil.report.figures.drawing import Drawing
from hil.report.sensor.material import SensorMaterial
from hil.report.sensor.panels import legend_of_all, side_by_side
from hil.report.sensor.words import PER_HOUR, noise
from hil.report.theme import FIRST, INK, MUTED, SECOND, plain_log_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from estimator.allan.noise import Noise


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
