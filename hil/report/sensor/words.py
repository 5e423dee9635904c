"""What the numbers of a recorded rate sensor say, in sentences."""

import math

from estimator.allan.noise import LEAST_POINTS, Noise, Reading, Term
from hil.numbers import count, quantity, significant, with_and
from hil.report.sensor.material import SensorMaterial

PER_HOUR = 3600.0 * math.degrees(1.0)
"""rad/s to °/h."""

PER_ROOT_HOUR = 60.0 * math.degrees(1.0)
"""rad/√s to °/√h."""

NAMES: dict[Term, tuple[str, str, float]] = {
    "quantisation": ("quantisation noise", "°", math.degrees(1.0)),
    "white": ("angle random walk", "°/√h", PER_ROOT_HOUR),
    "flicker": ("bias instability", "°/h", PER_HOUR),
    "rate random walk": ("rate random walk", "°/h/√h", PER_HOUR * 60.0),
    "ramp": ("rate ramp", "°/h/h", PER_HOUR * 3600.0),
}
"""Name, unit, and the unit in terms of rad and s."""

METHOD = (
    "Overlapping Allan deviation, read as IEEE Std 952-1997, Annex C, has it: angle random walk N where the curve "
    "falls as N/√τ, bias instability B from its lowest place, which is 0.664 B. Bands and intervals are 95 %, by the "
    "equivalent degrees of freedom of the noise at each length; nothing is read off with fewer than ten clusters. All "
    "that moves the output counts as noise here, a turning sensor and a warming one too: the figures are the sensor's "
    "only if it stood still."
)


def recorded(material: SensorMaterial) -> str:
    result, sensor = material.result, material.sensor
    axes = list(sensor.channels)
    said = (
        f"{sensor.device}: {count(len(axes))} {'axis' if len(axes) == 1 else 'axes'} ({', '.join(axes)}), "
        f"{sensor.sample_rate_Hz:.6g} samples a second by its own count, for {length(result.seconds)}: "
        f"{count(result.samples)} samples. Time in the record is the sensor's own."
    )
    if (apart := material.apart_ppm) is None or not result.seconds:
        return f"{said} How fast its clock runs takes more than a second to measure."
    faster = "faster" if apart >= 0 else "slower"
    return (
        f"{said} By this machine's clock its samples come {abs(apart):.0f} ppm {faster} than that; a millisecond in "
        f"which one arrives is {significant(1e3 / result.seconds, 2)} ppm of this record."
    )


def moved(material: SensorMaterial) -> str:
    """Which axes did not stand still, "" when none did not."""
    axes = [axis for axis in material.sensor.channels if material.moved(axis)]
    if not axes:
        return ""
    parts = []
    for axis in axes:
        channel = material.sensor.channels[axis]
        times = channel.sd_rad_s / (channel.noise_rad_s or math.inf)
        parts.append(f"{axis} by {significant(times)} times")
    return f"The output spreads wider than its white noise, {with_and(parts)}: the sensor turned, vibrated or drifted."


def noise(material: SensorMaterial) -> list[str]:
    """A sentence or two per axis on what its Allan deviation tells."""
    return [f"Axis {axis}: {_told(found)}." for axis, found in material.noise.items()]


def _told(found: Noise) -> str:
    if len(found.curve) < LEAST_POINTS or found.told_s is None:
        return "the record is too short for an Allan deviation"
    if found.fit is None:
        if not found.curve.deviation.any():
            return "every sample is the same; there is no noise to read"
        return (
            f"not determined. At clusters up to {quantity(found.told_s, 's')} the curve is not that of noise alone, "
            "as if the sensor turned or vibrated"
        )
    white = found.readings.get("white")
    first = "no stretch of the curve falls as white noise does, so no angle random walk is given"
    if white is not None:
        first = f"angle random walk {interval(white, 'white')}"
    if found.fit.from_s > found.curve.tau_s[0]:
        first += f", from clusters of {quantity(found.fit.from_s, 's')} on: shorter ones do not fit, as behind a filter"
    return f"{first}; {instability(found)}"


def instability(found: Noise) -> str:
    """The bias instability, or why there is none to tell, as half a sentence."""
    if (read := found.bias_instability) is not None:
        return f"bias instability {interval(read, 'flicker')}, read at τ = {quantity(read.tau_s, 's')}"
    if found.bias_bound_rad_s is None or found.told_s is None:
        return "bias instability not determined"
    below = f"{significant(found.bias_bound_rad_s * PER_HOUR, 2)}\u00a0°/h"
    if found.lowest_s != found.told_s:
        lowest = f"the lowest place of the curve, at τ = {quantity(found.lowest_s or 0.0, 's')}"
        return f"bias instability below {below} (95 %): other noise explains {lowest}"
    return (
        f"too short for the bias instability: at τ = {quantity(found.told_s, 's')}, the longest of which there are ten "
        f"clusters, the curve is not yet clear of white noise. It lies below {below} (95 %)"
    )


def interval(read: Reading, term: Term) -> str:
    """`0.152 °/√h (0.148 to 0.156)`: as many digits as the interval bears."""
    _, unit, factor = NAMES[term]
    width = (read.high - read.low) / 2 / read.value
    digits = min(max(1 - math.floor(math.log10(width)), 2), 5)
    value, low, high = (significant(number * factor, digits) for number in (read.value, read.low, read.high))
    return f"{value}\u00a0{unit} ({low} to {high})"


def length(seconds: float) -> str:
    """A time as people say it."""
    if seconds < 120.0:
        return quantity(seconds, "s")
    if seconds < 5400.0:
        return f"{significant(seconds / 60.0)} min"
    return f"{significant(seconds / 3600.0)} h"
