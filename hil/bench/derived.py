"""What a bench file's numbers come to, in the units in which a resonator is known: Hz, Q, decay time, split, azimuth.

One list for the terminal, `--json` and the report: a slip of units shows there.
"""

import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any, NamedTuple

from hil.bench.modes import frequencies_Hz, principal
from hil.bench.tables import Tables
from hil.numbers import count, percent, quantity, significant

_PER_UNIT = 1e-9  # of the stiffness, below which its axes have no direction


class Derived(NamedTuple):
    """A line: its name, its words, and its numbers by name, each with the unit at its end."""

    name: str
    text: str
    figures: Mapping[str, float | list[float]]


def derived(bench: Tables, identity: Mapping[str, Any] | None = None) -> list[Derived]:
    """The lines for a bench; `identity`: what the board says of its converters, where one was asked."""
    lines = [_resonance(bench), _damping(bench), *_sampling(bench), *_amplitude(bench, identity)]
    return [line for line in (*lines, *_drive(bench, identity), *_loop(bench)) if line is not None]


def figures_of(lines: list[Derived]) -> dict[str, float | list[float]]:
    """All numbers of the lines, as `--json` has them."""
    return {name: value for line in lines for name, value in line.figures.items()}


def quality_factors(bench: Tables) -> tuple[float, float]:
    """Q at the mean resonance along the axis of the least damping, and across it; infinite without damping."""
    omega = math.pi * sum(frequencies_Hz(bench.device.stiffness_per_s2))
    larger, smaller, _ = principal(bench.device.damping_per_s)
    most, least = (omega / one if one > 0.0 else math.inf for one in (smaller, larger))
    return most, least


def needed_mps2(bench: Tables) -> dict[str, float]:
    """Largest force per mass, m/s², that the control law needs at the declared amplitude, by what it is for: to bring
    the stiffness to its target, to undo the damping, to turn the pattern."""
    device, amplitude = bench.device, bench.device.amplitude_m
    target = bench.target_stiffness_per_s2
    omega = math.sqrt(target)
    larger, smaller, _ = principal(device.stiffness_per_s2)
    return {
        "stiffness mismatch": max(abs(larger - target), abs(smaller - target)) * amplitude,
        "damping": max(principal(device.damping_per_s).larger, 0.0) * omega * amplitude,
        "virtual rotation": 2.0 * abs(bench.controller.virtual_rotation_rad_s) * omega * amplitude,
    }


def _resonance(bench: Tables) -> Derived:
    higher, lower = frequencies_Hz(bench.device.stiffness_per_s2)
    mean, split = 0.5 * (higher + lower), higher - lower
    if bench.device.axes == 1:
        return Derived("resonance", _hertz(mean), {"resonance_Hz": mean})
    figures: dict[str, float | list[float]] = {
        "resonance_Hz": mean,
        "resonances_Hz": [higher, lower],
        "split_Hz": split,
    }
    if split <= _PER_UNIT * mean:
        return Derived("resonance", f"{_hertz(mean)} on both axes, no frequency split", figures)
    azimuth = math.degrees(principal(bench.device.stiffness_per_s2).azimuth_rad)
    text = f"{_hertz(mean)}; frequency split {_hertz(split)}, the higher at {significant(azimuth)}° from x"
    return Derived("resonance", text, figures | {"azimuth_deg": azimuth})


def _damping(bench: Tables) -> Derived | None:
    along = principal(bench.device.damping_per_s)
    if along.larger <= 0.0 or bench.device.resonance_Hz == 0.0:
        return None
    most, least = quality_factors(bench)
    rates = [0.5 * along.smaller, 0.5 * along.larger]  # 1/τ of the amplitude
    if bench.device.axes == 1 or along.larger - along.smaller <= _PER_UNIT * along.larger:
        tau = 1.0 / rates[1]
        text = f"Q {significant(least)}, decay time {quantity(tau, 's')}, 1/τ {significant(rates[1])} 1/s"
        return Derived("damping", text, {"q": least, "decay_time_s": tau, "decay_rate_per_s": rates[1]})
    azimuth = math.degrees(along.azimuth_rad)
    text = (
        f"Q {significant(least)} and {significant(most)}, 1/τ {significant(rates[1])} and {significant(rates[0])} 1/s, "
        f"the first at {significant(azimuth)}° from x"
    )
    figures: dict[str, float | list[float]] = {"decay_rate_per_s": rates[::-1], "damping_azimuth_deg": azimuth}
    if math.isfinite(most) and along.smaller > 0.0:
        figures |= {"q": [least, most], "decay_time_s": [1.0 / rate for rate in rates[::-1]]}
    return Derived("damping", text, figures)


def _sampling(bench: Tables) -> Iterator[Derived]:
    device = bench.device
    if device.resonance_Hz == 0.0 or device.sense.is_envelope:
        return
    mean = 0.5 * sum(frequencies_Hz(device.stiffness_per_s2))
    cycles = device.sample_rate_Hz / mean
    yield Derived(
        "sampling",
        f"{quantity(device.sample_rate_Hz, 'Hz')}, {significant(cycles)} samples a cycle",
        {"samples_per_cycle": cycles},
    )
    if bench.observer.gain != "ekf":
        memory = bench.memory_s * mean
        text = f"{quantity(bench.memory_s, 's')}, {significant(memory)} cycles"
        yield Derived("memory", text, {"memory_cycles": memory})


def _amplitude(bench: Tables, identity: Mapping[str, Any] | None) -> Iterator[Derived]:
    device = bench.device
    if device.sense.order or device.sense.is_envelope or device.sense.unit != "V":
        return
    volts = [abs(gain) * device.amplitude_m for gain in device.sense_gains_V_per_m]
    shown = _together([quantity(one, "V") for one in volts])
    decibels = 20.0 * math.log10(min(volts) / device.sense.noise_V)
    text = f"{quantity(device.amplitude_m, 'm')} is {shown}, {significant(decibels)} dB above the noise of a sample"
    figures: dict[str, float | list[float]] = {"amplitude_V": volts, "amplitude_over_noise_dB": decibels}
    if identity is not None:
        codes = [one / float(identity["sense_scale_V"]) for one in volts]
        share = max(codes) / 2 ** (int(identity["sense_bits"]) - 1)
        text += f", {_together([significant(one) for one in codes])} codes, {percent(share)} of the converter's range"
        figures |= {"amplitude_codes": codes, "amplitude_of_range": share}
    yield Derived("amplitude", text, figures)


def _drive(bench: Tables, identity: Mapping[str, Any] | None) -> Iterator[Derived]:
    if not bench.controller.enabled:
        return
    needed, limit = needed_mps2(bench), float(bench.drive_limit_mps2)
    apart = needed["stiffness mismatch"]
    text = (
        f"stiffness mismatch needs {quantity(apart, 'm/s²')}, {percent(apart / limit)} of {quantity(limit, 'm/s²')}; "
        f"with damping and virtual rotation {percent(sum(needed.values()) / limit)}"
    )
    figures: dict[str, float | list[float]] = {
        "drive_for_mismatch_mps2": apart,
        "drive_for_mismatch_of_limit": apart / limit,
        "drive_needed_of_limit": sum(needed.values()) / limit,
    }
    if identity is not None:
        codes = int(bench.drive_limit_mps2 / Fraction(float(identity["drive_scale_mps2"])))
        codes = min(codes, 2 ** (int(identity["drive_bits"]) - 1) - 1)  # drive codes are symmetric about zero
        full = board_full_scale_mps2(identity)
        text += f"; the limit is {count(codes)} codes; by IDENTITY the board's codes end at {quantity(full, 'm/s²')}"
        figures |= {"drive_limit_codes": codes, "drive_full_scale_of_board_mps2": full}
    yield Derived("drive", text, figures)


def board_full_scale_mps2(identity: Mapping[str, Any]) -> float:
    """Force per mass at the end of the board's drive codes, as it tells them."""
    return float(identity["drive_scale_mps2"]) * 2.0 ** (int(identity["drive_bits"]) - 1)


def _loop(bench: Tables) -> Iterator[Derived]:
    if not bench.controller.enabled:
        return
    rate = bench.device.sample_rate_Hz
    if bench.loop.mode == "gain":
        loop = rate / bench.loop.block
        text = f"{quantity(loop, 'Hz')}: a matrix for each block of {bench.loop.block} samples"
    elif bench.loop.mode == "board":
        loop, text = rate, f"{quantity(rate, 'Hz')}, on the board; permitted anew for each {bench.loop.block} samples"
    else:
        loop, text = rate, f"{quantity(rate, 'Hz')}: an answer to each sample"
    yield Derived("loop rate", text, {"loop_rate_Hz": loop})


def _hertz(value: float) -> str:
    return quantity(value, "Hz", 5)


def _together(texts: list[str]) -> str:
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)
