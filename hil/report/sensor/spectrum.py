"""Spectrum of each axis: a line in it is vibration or a spinning table, and no noise."""

import math

import numpy as np

from hil.numbers import prefix_for, significant
from hil.report.figures.drawing import Drawing
from hil.report.figures.spectrum import amplitude_density
from hil.report.sensor.material import SensorMaterial
from hil.report.sensor.panels import legend_of_all, side_by_side
from hil.report.theme import FIRST, INK, plain_log_ticks

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
    where = "the whole record" if not material.gaps else "the longest stretch without a gap"
    caption = (
        f"Amplitude spectral density of {where} (Welch, the mean taken out). Dashed, the white noise that the Allan "
        "deviation gives, √2 N: two ways to one number. A line that stands out is vibration or rotation."
    )
    return Drawing(figure, "Spectrum", caption, f"Spectra: {', '.join(peaks)}. {caption}")
