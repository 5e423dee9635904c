"""What a verb does not do with a bench file: keys that it has no use for, and values that it refuses.

A bench file serves several verbs, and a run keeps it as it was given: a key that does not act must not look as if it
had.  Where the verb has no use for a key at all, the reference page says so (`NOT_OF`); where it would do something
else than the value says, it refuses.
"""

from collections.abc import Iterator
from typing import Literal

from hil.bench.bench import Bench
from hil.bench.classic import Loops
from hil.bench.data_sheet import FIGURES
from hil.bench.loop import LEAST_ROWS
from hil.errors import InputError
from hil.numbers import counted

Verb = Literal["run", "replay", "trace", "compare"]

_BESIDE = ("reference.link", "reference.axis", "reference.sign")
_BOARD = (
    *_BESIDE,
    "link.url",
    "link.watchdog_s",
    "link.timeout_s",
    "loop.clock",
    "loop.seed",
    "loop.filter",
    "loop.block",
)
_CONTROL = tuple(
    f"controller.{key}"
    for key in (
        "stiffness_step", "stiffness_step_Hz", "plugin", *(f"loops.{key}" for key in Loops.model_fields),
        "energy_gain", "quadrature_gain", "amplitude_modulation", "modulation_Hz",
    )
)  # fmt: skip
_TRIMMED = tuple(
    f"trim.{key}" for key in ("control", "limit_V", "ramp_V_per_s", "time_constant_s", "period_s", "tolerance")
)
_GUARDS = tuple(f"limits.{key}" for key in ("overtime", "rearm", "standstill_s"))
_MACHINE = ("limits.late_fraction", "limits.lost_fraction")
_JUDGED = ("limits.energy_error", "limits.quadrature", "limits.invalid_fraction")
_SHEET = {f"limits.{figure.key}": "hil characterise holds its figures against it" for figure in FIGURES}
_MAP = "device.calibration.angle_map"
_CALIBRATION = (
    *(
        f"device.calibration.{key}"
        for key in (
            "angular_gain_u", "clock_u", "drive_gain_u", "drive_misalignment_u", "drive_delay_u_s",
            "sense_gain_ratio_u", "sense_cross_coupling_u", "sense_delay_u_s",
        )
    ),
    "device.sense.interface.constant_u",
    "device.sense.interface.temperature_u_K",
)  # fmt: skip

_OF_A_BOARD, _DRIVEN = "only a board needs it", "the drive of the loop is in the record"
_STOPPED, _VERDICT = "nothing has to be stopped", "only the verdict of a run needs it"

NOT_OF: dict[Verb, dict[str, str]] = {
    "run": _SHEET,
    "replay": {
        **_SHEET,
        **dict.fromkeys((*_BOARD, "loop.duration_s"), _OF_A_BOARD),
        **dict.fromkeys((*_CONTROL, *_TRIMMED), _DRIVEN),
        **dict.fromkeys((*_GUARDS, "limits.residual_safe"), _STOPPED),
        **dict.fromkeys(_MACHINE, _OF_A_BOARD),
    },
    "trace": {
        **_SHEET,
        **dict.fromkeys((*_BOARD, "loop.duration_s"), _OF_A_BOARD),
        **dict.fromkeys((*_CONTROL, *_TRIMMED, "controller.mode", "controller.dither_mps2"), _DRIVEN),
        **dict.fromkeys((*_GUARDS, "limits.residual_safe"), _STOPPED),
        **dict.fromkeys((*_MACHINE, "limits.angle_rad", *_JUDGED), _VERDICT),
        **dict.fromkeys(("loop.estimate_every", "loop.covariance_every"), "every sample is used"),
        **dict.fromkeys(_CALIBRATION, "only the angle's uncertainty needs it"),
        _MAP: "no angle is reported",
        "device.normalised": "a trace reports effects per unit mass",
    },
    "compare": {
        "link.url": "the board is given as --link, on which each algorithm runs with all of the other keys",
        "limits.overtime": "it runs in lockstep",
        **dict.fromkeys(_TRIMMED, "nothing is trimmed"),
    },
}
"""Keys that a verb has no use for, by `section.key`, each with the reason."""


def of_a_record(bench: Bench) -> Bench:
    """As a record is gone through: what [controller] mode drove is in it, and the bench's own observer reads it."""
    return bench if bench.controller.mode == "whole_angle" else bench.with_(controller={"mode": "whole_angle"})


def require_usable(bench: Bench, verb: Verb) -> None:
    """InputError, one line, for the first value that the verb would not do as it says."""
    for where, why in _refused(bench, verb):
        raise InputError(f"{bench.device.name}: {where}: {why}")


def _refused(bench: Bench, verb: Verb) -> Iterator[tuple[str, str]]:
    observer, device = bench.observer, bench.device
    if verb != "replay" and observer.backend != "c":
        yield (
            "[observer] backend",
            f'"{observer.backend}" is for hil replay alone, hil {verb} has "c"; take the key out, and give '
            f"hil replay --backend {observer.backend}",
        )
    if verb in ("run", "replay") and observer.variant == "gyro" and observer.gain == "stationary" and bench.offset_sd_V:
        yield (
            "[observer] variant",
            f'"gyro" with gain = "stationary" takes the sense offsets as zero, offset_sd_V is {bench.offset_sd_V:g} V; '
            'use variant = "full", which estimates them (hil compare runs "gyro" as prior art)',
        )
    loop, rate = bench.loop, device.sample_rate_Hz
    if verb == "run" and (rows := loop.scored_rows(rate, loop.estimate_every)) < LEAST_ROWS:
        enough = loop.coarsest_estimates(rate)
        yield (
            "[loop] estimate_every",
            f"{loop.estimate_every} leaves {counted(rows, 'row')} of estimates from settle_s = {loop.settle_s:g} s to "
            f"duration_s = {loop.duration_s:g} s, {LEAST_ROWS} are needed; "
            + (f"give at most {enough}" if enough else "run for longer"),
        )
    if verb == "run" and device.drive.hold != "zoh":
        yield (
            "[device.drive] hold",
            f'"{device.drive.hold}" is of imported records, a board holds each drive; take the key out',
        )
    if verb == "run" and device.sense.unit != "V":
        yield (
            "[device.sense] unit",
            f'"{device.sense.unit}" is of imported records, a board counts in volts; give gain and noise in V',
        )
