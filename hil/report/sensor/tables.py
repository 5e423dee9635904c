"""Tables of the axes: what each put out, and the noise in it."""

import math

from hil.numbers import plus_minus, prefix_for, significant
from hil.records.result import Channel
from hil.report.markup import table
from hil.report.sensor.material import SensorMaterial
from hil.report.sensor.words import NAMES, PER_HOUR, interval


def axes(material: SensorMaterial) -> str:
    """Mean, spread, noise and extremes of each axis."""
    spread = max((channel.sd_rad_s for channel in material.sensor.channels.values()), default=0.0)
    factor, prefix = prefix_for(math.degrees(spread))
    rows = []
    for axis, rate in material.rates_rad_s.items():
        channel = material.sensor.channels[axis]
        noise = "–" if channel.noise_rad_s is None else significant(math.degrees(channel.noise_rad_s) * factor)
        rows.append(
            (
                axis,
                _mean(channel, rate.size),
                significant(math.degrees(channel.sd_rad_s) * factor),
                noise,
                significant(math.degrees(float(rate.min())), 4),
                significant(math.degrees(float(rate.max())), 4),
            )
        )
    unit = f"({prefix}deg/s)"
    head = ("axis", "mean / (deg/s)", f"standard deviation / {unit}", f"white noise of a sample / {unit}")
    caption = "Each axis over the whole record; white noise by the differences of neighbouring samples"
    return table(caption, (*head, "least / (deg/s)", "most / (deg/s)"), rows, (1, 2, 3, 4, 5))


def _mean(channel: Channel, samples: int) -> str:
    """In deg/s, to the digits that white noise of its spread leaves it."""
    mean, sd = math.degrees(channel.mean_rad_s), math.degrees(channel.sd_rad_s)
    return plus_minus(mean, 2.0 * sd / math.sqrt(samples), beside=mean)


def noise(material: SensorMaterial) -> str:
    """What the Allan deviation of each axis shows."""
    rows = []
    for axis, found in material.noise.items():
        for term, read in found.readings.items():
            if term != "flicker":
                rows.append((axis, NAMES[term][0], interval(read, term), f"{significant(read.tau_s)} s"))
        if found.bias_instability is not None:
            read = found.bias_instability
            rows.append((axis, "bias instability", interval(read, "flicker"), f"{significant(read.tau_s)} s"))
        elif found.bias_bound_rad_s is not None:
            bound = f"too short to tell; below {significant(found.bias_bound_rad_s * PER_HOUR, 2)}\u00a0°/h"
            rows.append((axis, "bias instability", bound, f"{significant(found.told_s or 0.0)} s"))
    head = ("axis", "noise", "value, 95 % interval", "read at τ")
    return table("Noise, as far as the record tells", head, rows, (3,)) if rows else ""
