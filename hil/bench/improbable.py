"""Numbers of a bench file that may be meant but seldom are: each is questioned in one line, none is refused.

A line says what the number comes to, what is usual, and which slip would give it. What cannot be meant at all is
refused when the file is read (`hil.bench.plausible`).
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from hil.bench.derived import board_full_scale_mps2, needed_mps2, quality_factors
from hil.bench.modes import frequencies_Hz
from hil.bench.tables import Tables
from hil.numbers import percent, quantity, significant

# What is usual of vibrating gyros, from silicon rings of a few ng to hemispherical resonators and demonstrators.
Q_USUAL = 30.0, 3e7
MASS_KG = 1e-11, 1e-2
RESONANCE_HZ = 50.0, 3e5
AMPLITUDE_M = 1e-9, 5e-4
SAMPLES_PER_CYCLE = 8.0, 1000.0
SPLIT_OF_RESONANCE = 0.5
AMPLITUDE_OVER_NOISE = 10.0, 1e7
RATE_RAD_S = 100.0  # 5700 °/s
ANGLE_RAD = 0.5
FORCE_MODE_HZ = 2e4  # a read and write on a pty takes 30 to 100 µs, over USB 125 µs to 1 ms
MEMORY_OF_RUN = 0.5
LEAST_MEMORY_CYCLES = 20.0
CLOCK_U = 1e-3
TARGET_OFF = 0.1
FULL_SCALE_OFF = 0.01  # a converter's largest code is up to 2^-7 short of its full scale
DRIVE_OF_LIMIT = 1.25  # what is declared is a data sheet's, known to some percent


def questions(bench: Tables, identity: Mapping[str, Any] | None = None) -> list[str]:
    """What somebody should look at again, as `[section] key: what; usual; slip`; empty where all is usual.  identity:
    what the board tells of its codes.
    """
    if bench.device.resonance_Hz == 0.0:
        return []
    beside_board = () if identity is None else _full_scale(bench, identity)
    return [*_mass(bench), *_resonator(bench), *_signals(bench), *_run(bench), *_angles(bench), *beside_board]


def _full_scale(bench: Tables, identity: Mapping[str, Any]) -> Iterator[str]:
    declared, board = float(bench.device.drive_full_scale_mps2), board_full_scale_mps2(identity)
    if abs(declared - board) > FULL_SCALE_OFF * board:
        yield (
            f"[device.drive] full_scale: {quantity(declared, 'm/s²')} declared; the board's codes end at "
            f"{quantity(board, 'm/s²')} by IDENTITY; another unit, or a wrong scale in the firmware?"
        )


def beside(finding: str, bench: Tables) -> str:
    """A refusal, and the slip in mass or stiffness that would explain it, where there is one."""
    return "; ".join([finding, *_mass(bench)][:2])


def _mass(bench: Tables) -> Iterator[str]:
    device = bench.device
    mean = 0.5 * sum(frequencies_Hz(device.stiffness_per_s2))
    least, most = MASS_KG
    if not least <= device.mass_kg <= most:
        slip = "grams for kilograms" if device.mass_kg > most else "a mass in another unit"
        yield f"[device] mass_kg: {device.mass_kg:g} kg; usual {least:g} to {most:g} kg; {slip}?"
    least, most = RESONANCE_HZ
    if not least <= mean <= most:
        slip = "grams for kilograms, or kN/m for N/m" if mean < least else "rad/s for Hz, or a mass in another unit"
        yield (
            f"[device] mass_kg, stiffness_N_per_m: they resonate at {quantity(mean, 'Hz')}; usual {least:g} Hz to "
            f"{most / 1e3:g} kHz; {slip}?"
        )


def _resonator(bench: Tables) -> Iterator[str]:
    device = bench.device
    higher, lower = frequencies_Hz(device.stiffness_per_s2)
    mean = 0.5 * (higher + lower)
    least, most = Q_USUAL
    best, worst = quality_factors(bench)
    if worst < least:
        entered = max(device.damping_N_s_per_m)
        slip = f"a Q entered as damping? give q = {entered:g}" if entered >= least else "a damping ratio as damping?"
        yield f"[device] damping_N_s_per_m: Q is {significant(worst)}; usual {least:g} to {most:g}; {slip}"
    elif math.isfinite(best) and best > most:
        told = f"[device] damping_N_s_per_m: Q is {significant(best)}"
        yield f"{told}; usual {least:g} to {most:g}; a damping over the mass?"
    if higher - lower > SPLIT_OF_RESONANCE * mean:
        yield (
            f"[device] stiffness_N_per_m: the resonances are {quantity(higher - lower, 'Hz')} apart; usual below "
            f"{percent(SPLIT_OF_RESONANCE, 0)} of {quantity(mean, 'Hz')}; one entry in another unit?"
        )
    target = math.sqrt(bench.target_stiffness_per_s2) / math.tau
    if bench.controller.enabled and abs(target / mean - 1.0) > TARGET_OFF:
        ratio = max(target / mean, mean / target)
        slip = "Hz for rad/s" if abs(ratio / math.tau - 1.0) < TARGET_OFF else "the stiffness of another device"
        yield (
            f"[controller] target_stiffness_N_per_m: {quantity(target, 'Hz')}, the device resonates at "
            f"{quantity(mean, 'Hz')}; usual within 1 %; {slip}?"
        )


def _signals(bench: Tables) -> Iterator[str]:
    device = bench.device
    least, most = AMPLITUDE_M
    if not least <= device.amplitude_m <= most:
        slip = "µm for m" if device.amplitude_m > most else "an amplitude in another unit"
        yield (
            f"[device] amplitude_m: {quantity(device.amplitude_m, 'm')}; usual {quantity(least, 'm', 1)} to "
            f"{quantity(most, 'm')}; {slip}?"
        )
    if not device.sense.is_envelope:
        least, most = SAMPLES_PER_CYCLE
        cycle = device.sample_rate_Hz / (0.5 * sum(frequencies_Hz(device.stiffness_per_s2)))
        if not least <= cycle <= most:
            slip = "kHz for Hz, or rad/s for Hz" if cycle < least else "Hz for rad/s"
            yield (
                f"[device] sample_rate_Hz: {significant(cycle)} samples a cycle; usual {least:g} to {most:g}; {slip} "
                "in the resonance?"
            )
    if device.sense.order == 0 and not device.sense.is_envelope and device.sense.unit == "V":
        least, most = AMPLITUDE_OVER_NOISE
        ratio = min(map(abs, device.sense_gains_V_per_m)) * device.amplitude_m / device.sense.noise_V
        if not least <= ratio <= most:
            slip = "V/µm for V/m" if ratio < least else "V/m for V/µm, or a noise density for the rms of a sample"
            yield (
                f"[device.sense] gain_V_per_m, noise_V: the amplitude is {significant(ratio)} times the noise; usual "
                f"{least:g} to {most:g}; {slip}?"
            )


def _run(bench: Tables) -> Iterator[str]:
    observer, loop, rate = bench.observer, bench.loop, bench.device.sample_rate_Hz
    if observer.gain != "ekf":
        if bench.memory_s > MEMORY_OF_RUN * loop.duration_s:
            yield (
                f"[observer] memory_s: {bench.memory_s:g} s in a run of {loop.duration_s:g} s; usual some hundred "
                "cycles and below a tenth of the run; ms for s?"
            )
        cycles = bench.memory_s * bench.device.resonance_Hz
        if cycles < LEAST_MEMORY_CYCLES:
            yield f"[observer] memory_s: {significant(cycles)} cycles; usual some hundred; ms for s?"
    if not bench.controller.enabled:
        return
    if loop.mode == "force" and loop.clock != "lockstep" and rate > FORCE_MODE_HZ:
        yield (
            f'[loop] mode: "force" at {rate / 1e3:g} kS/s; no link answers each sample above '
            f'{FORCE_MODE_HZ / 1e3:g} kS/s; mode = "gain", or clock = "lockstep"?'
        )
    needed, limit = needed_mps2(bench), float(bench.drive_limit_mps2)
    if (total := sum(needed.values())) > DRIVE_OF_LIMIT * limit:
        largest = max(needed, key=lambda name: needed[name])
        yield (
            f"[device.drive] full_scale: the control law needs {quantity(total, 'm/s²')}, most of it for {largest}; "
            f"the drive has {quantity(limit, 'm/s²')}; N for m/s²?"
        )


def _angles(bench: Tables) -> Iterator[str]:
    spread, noise = bench.observer.initial_sd, bench.observer.process_noise
    for place, value, unit in (
        ("[observer.initial_sd] rate_rad_s", spread.rate_rad_s, "rad/s"),
        ("[observer.initial] rate_rad_s", bench.observer.initial.rate_rad_s, "rad/s"),
        ("[observer.process_noise] rate_rad_s_per_rts", noise.rate_rad_s_per_rts, "rad/s per √s"),
        ("[controller] virtual_rotation_rad_s", bench.controller.virtual_rotation_rad_s, "rad/s"),
    ):
        if abs(value) > RATE_RAD_S:
            other = place.partition("] ")[2].replace("_rad_s", "_dps")
            yield (
                f"{place}: {value:g} {unit} is {math.degrees(value):.4g} °/s; usual below {RATE_RAD_S:g}; "
                f"°/s for rad/s? give {other}"
            )
    if bench.limits.angle_rad > ANGLE_RAD:
        angle = bench.limits.angle_rad
        yield (
            f"[limits] angle_rad: {angle:g} rad is {math.degrees(angle):.4g}°; usual below {ANGLE_RAD:g}; degrees? "
            "give angle_deg"
        )
    clock = bench.device.calibration.clock_u
    if clock is not None and clock > CLOCK_U:
        told = f"[device.calibration] clock_u: {clock:g} is {1e6 * clock:g} ppm"
        yield f"{told}; usual 1 to 100 ppm; ppm? give clock_u_ppm"
