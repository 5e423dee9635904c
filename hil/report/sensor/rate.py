"""The rates over time."""

import numpy as np

from hil.numbers import prefix_for, significant
from hil.report.figures.drawing import Drawing
from hil.report.pixel_series import pixel_series
from hil.report.sensor.material import SensorMaterial
from hil.report.theme import FIRST, span_time, stacked, trace


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
