"""Numbers that are each allowed by themselves, but describe nothing that can vibrate, be sensed or be observed.

Bounds are far outside what any device or run has: they catch a slipped exponent or unit, not an unusual device.
"""

import math
from collections.abc import Iterator

from hil.bench.tables import Tables

FASTEST_HZ = 1e8
LARGEST_M = 10.0
LARGEST_V = 1e3
LONGEST_RUN = 1e12  # samples
LONGEST_WAIT_S = 3600.0
SLOWEST = 1e6  # samples a cycle
LEAST_SNR, GREATEST_SNR = 1e-3, 1e9
TABLE_SAMPLES = 2e7  # that a stationary gain is computed from, a microsecond each


def implausible(bench: Tables) -> str | None:
    """The first thing that cannot be meant, as `[section] key: what; remedy`; None where all is plausible."""
    return next(_findings(bench), None)


def _findings(bench: Tables) -> Iterator[str]:
    yield from _device(bench)
    yield from _run(bench)
    yield from _observer(bench)
    yield from _controller(bench)


def _device(bench: Tables) -> Iterator[str]:
    device = bench.device
    if device.sample_rate_Hz > FASTEST_HZ:
        yield f"[device] sample_rate_Hz: {device.sample_rate_Hz:g} Hz is beyond {FASTEST_HZ:g}; the unit is hertz"
    if bench.controller.enabled and device.amplitude_m > LARGEST_M:  # a record from elsewhere may have units of its own
        yield f"[device] amplitude_m: {device.amplitude_m:g} m is beyond {LARGEST_M:g}; the unit is metres"
    omega0 = math.sqrt(bench.target_stiffness_per_s2)
    volts = max(bench.swing_V)
    if device.sense.is_in_decibels:
        volts = device.sense.noise_V  # a noise in dB has no ratio to an amplitude
    if volts > LARGEST_V and device.sense.unit == "V":
        yield f"[device.sense] gain_V_per_m: the amplitude would be {volts:.3g} V; the unit is volts per metre"
    if not LEAST_SNR <= volts / device.sense.noise_V <= GREATEST_SNR:
        yield (
            f"[device.sense] noise_V: the amplitude is {volts / device.sense.noise_V:.3g} times the noise of a sample; "
            f"expected {LEAST_SNR:g} to {GREATEST_SNR:g}: check amplitude_m, gain_V_per_m and noise_V"
        )
    if not math.isfinite(omega0) or math.tau * device.sample_rate_Hz > SLOWEST * omega0:
        yield (
            f"[device] mass_kg: {omega0 / math.tau:.3g} Hz is no resonance for {device.sample_rate_Hz:g} "
            "samples a second; check mass_kg and stiffness_N_per_m"
        )
    if not all(map(math.isfinite, (*device.stiffness_per_s2, *device.damping_per_s))):
        yield "[device] mass_kg: stiffness or damping over it is no number; check the units"


def _run(bench: Tables) -> Iterator[str]:
    loop, link, rate = bench.loop, bench.link, bench.device.sample_rate_Hz
    if loop.duration_s * rate > LONGEST_RUN:
        yield f"[loop] duration_s: {loop.duration_s:g} s are more than {LONGEST_RUN:g} samples; the unit is seconds"
    for key in ("estimate_every", "covariance_every"):
        if (getattr(loop, key) or 0) > LONGEST_RUN:
            yield f"[loop] {key}: beyond {LONGEST_RUN:g} samples; it counts samples"
    for key, value in (("watchdog_s", link.watchdog_s or 0.0), ("timeout_s", link.timeout_s)):
        if value > LONGEST_WAIT_S:
            yield f"[link] {key}: {value:g} s is beyond {LONGEST_WAIT_S:g}; the unit is seconds"


def _observer(bench: Tables) -> Iterator[str]:
    observer, rate = bench.observer, bench.device.sample_rate_Hz
    omega0 = math.sqrt(bench.target_stiffness_per_s2)
    cycle_s = bench.cycle_s
    vibrates = bench.device.resonance_Hz > 0.0  # a mass on no spring has no cycle
    if vibrates and observer.gain != "ekf" and bench.memory_s < cycle_s:
        yield (
            f"[observer] memory_s: {bench.memory_s:g} s is shorter than a cycle of {1 / cycle_s:.4g} Hz, from which "
            f'nothing can be estimated; give at least {_rounded_up(cycle_s)} s, or gain = "ekf", which forgets nothing'
        )
    if observer.gain == "stationary" and 4.0 * bench.memory_s * rate > TABLE_SAMPLES:
        yield (
            f"[observer] memory_s: a stationary gain for {bench.memory_s:g} s at {rate:g} Hz takes "
            f'{4e-6 * bench.memory_s * rate:.3g} s to compute; use gain = "ekf", which forgets nothing, or at most '
            f"{TABLE_SAMPLES / (4.0 * rate):.3g} s"
        )
    spread, noise = observer.initial_sd, observer.process_noise
    fastest = omega0 if bench.device.axes == 2 else math.inf  # a single axis has no rate
    for where, key, value, limit in (
        ("initial_sd", "rate_rad_s", spread.rate_rad_s, fastest),
        ("initial_sd", "stiffness", spread.stiffness, 1.0),
        ("initial_sd", "position", spread.position, 1e3),
        ("initial_sd", "velocity", spread.velocity, 1e3),
        ("initial_sd", "damping", spread.damping, 1e6),
        ("process_noise", "rate_rad_s_per_rts", noise.rate_rad_s_per_rts, fastest * math.sqrt(omega0)),
        ("process_noise", "stiffness_per_rts", noise.stiffness_per_rts, math.sqrt(omega0)),
    ):
        if value > limit:
            yield f"[observer.{where}] {key}: {value:g} is beyond {limit:.3g}, where nothing is left of the model"


def _rounded_up(value: float) -> str:
    """To three digits, and never below the value.

    >>> _rounded_up(1.0201)
    '1.03'
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.ceil(value / unit - 1e-9) * unit:.3g}"


def _controller(bench: Tables) -> Iterator[str]:
    controller, device = bench.controller, bench.device
    if not controller.enabled:
        return
    omega0 = math.sqrt(bench.target_stiffness_per_s2)
    if abs(controller.virtual_rotation_rad_s) > 0.1 * omega0:
        yield (
            f"[controller] virtual_rotation_rad_s: {controller.virtual_rotation_rad_s:g} rad/s is no slow rotation of "
            f"a pattern that vibrates at {omega0:.4g} rad/s; give less than a tenth of that"
        )
    if 0.0 < controller.virtual_reversal_s < bench.cycle_s:
        yield (
            f"[controller] virtual_reversal_s: {controller.virtual_reversal_s:g} s is shorter than a cycle of "
            f"{1 / bench.cycle_s:.4g} Hz, within which no pattern rotates; usually seconds, 0 never reverses"
        )
    for key in ("energy_gain", "quadrature_gain"):
        if getattr(controller, key) > 1.0:
            yield (
                f"[controller] {key}: {getattr(controller, key):g} acts within less than a cycle; it is in units "
                "of the target frequency, usually 0.003 to 0.1"
            )
    full_scale = float(device.drive_full_scale_mps2)
    if controller.dither_mps2 > full_scale:
        yield (
            f"[controller] dither_mps2: {controller.dither_mps2:g} m/s² is beyond the drive's full scale of "
            f"{full_scale:.4g}; give a hundredth of it or less"
        )
