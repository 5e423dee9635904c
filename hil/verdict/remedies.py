"""What lowers a row of the angle's uncertainty: a setting of the bench file, or something to be done."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from hil.bench import Bench
from hil.bench.classic import CLASSIC
from hil.records.result import Contribution
from hil.verdict.budget import LACKING, UNDECLARED
from hil.verdict.uncertainty import DAMPING, ESTIMATION

_TURNED = 2e-3
"""Of the resonance, rad/s: about the virtual rotation of the examples."""
_SLOWER = 10.0
"""Times that a declared change of the rate is lowered by."""


class Remedy(NamedTuple):
    """What lowers a row, in words; changes: the settings that it names, as tables of a bench file, empty where it is
    something to be done; calibrates: the key of [device.calibration] that is to be known better, "" else."""

    text: str
    changes: Mapping[str, Mapping[str, object]] = MappingProxyType({})
    calibrates: str = ""


def remedy(row: Contribution, bench: Bench) -> Remedy:
    """The setting, or the act, that lowers a row.  A constant that is off turns the pattern before it is turned back:
    only what is merely uncertain at the end cancels in a reversal.
    """
    controller, plugged = bench.controller, bench.controller.plugin is not None
    one_way = controller.virtual_rotation_rad_s != 0.0 and controller.virtual_reversal_s == 0.0
    if row.source in ("drive gain", "sense gain ratio", "clock") and one_way and not row.found and not plugged:
        period = _there_and_back(bench)
        return Remedy(
            f"set [controller] virtual_reversal_s = {period:g}, so that a gain error cancels, and run again",
            {"controller": {"virtual_reversal_s": period}},
        )
    if row.source == ESTIMATION:
        return _estimation(row, bench)
    if row.source == UNDECLARED:
        return _excitation(bench)
    if row.source == LACKING:
        return Remedy("hil trace RUN --add better.bench.toml, then hil run better.bench.toml")
    if row.source == DAMPING:
        return Remedy("measure the damping, and declare its uncertainty by [observer.initial_sd] damping")
    key = f"{row.source.replace(' ', '_')}_u{'_s' if row.unit == 's' else ''}"
    return Remedy(f"calibrate it, and declare its uncertainty by [device.calibration] {key}", calibrates=key)


def _there_and_back(bench: Bench) -> float:
    """A period of the reversal, s, by which the scored window turns as far back as there, by no more than half a turn
    at a time: what a gain does to the one is then cancelled by the other.
    """
    scored = bench.loop.duration_s - bench.loop.settle_s
    longest = abs(math.pi / bench.controller.virtual_rotation_rad_s)
    return _rounded(scored / (2.0 * math.ceil(scored / (2.0 * longest))), 3)


def _estimation(row: Contribution, bench: Bench) -> Remedy:
    if bench.controller.mode in CLASSIC:
        xx, yy, xy = bench.device.damping_per_s
        turned = 0.5 * math.hypot(0.5 * (xx - yy), xy) * (bench.loop.duration_s - bench.loop.settle_s)
        if turned > math.sqrt(0.5) * row.contribution_rad:  # most of the variance
            return Remedy(
                'set [controller] mode = "whole_angle", which estimates the damping, and run again',
                {"controller": {"mode": "whole_angle"}},
            )
    walk = bench.observer.process_noise.rate_rad_s_per_rts
    if walk == 0.0 or bench.observer.plugin is not None:  # which makes its uncertainty by itself
        return Remedy("vibrate with a larger [device] amplitude_m, as far as the device allows, and run again")
    slower = _rounded(walk / _SLOWER)
    return Remedy(
        f"set [observer.process_noise] rate_rad_s_per_rts = {slower:g} if the rate changes no faster, and run again",
        {"observer": {"process_noise": {"rate_rad_s_per_rts": slower}}},
    )


def _excitation(bench: Bench) -> Remedy:
    """What makes a record say more of what nobody declared: a pattern that turns further, as far as the drive can turn
    it. Dither adds next to nothing to that.
    """
    controller, omega = bench.controller, math.sqrt(bench.target_stiffness_per_s2)
    if not controller.enabled:
        return Remedy(
            "run with the control law on ([controller] enabled), so that the record says more of the device",
            {"controller": {"enabled": True}},
        )
    rate = _rounded(2.0 * abs(controller.virtual_rotation_rad_s) or _TURNED * omega)
    if controller.plugin is not None or 2.0 * rate * omega * bench.device.amplitude_m > 0.5 * bench.drive_limit_mps2:
        return Remedy("hil trace the run: it proposes the experiment that separates what is left")
    changes: dict[str, object] = {"virtual_rotation_rad_s": rate}
    reversal = ""
    if controller.virtual_reversal_s == 0.0:
        changes["virtual_reversal_s"] = _rounded(math.pi / rate)
        reversal = f" and virtual_reversal_s = {changes['virtual_reversal_s']:g}"
    return Remedy(
        f"set [controller] virtual_rotation_rad_s = {rate:g}{reversal}, so that the device becomes more observable, "
        "and run again",
        {"controller": changes},
    )


def _rounded(value: float, digits: int = 2) -> float:
    """To so many digits, as it is told."""
    return float(f"{value:.{digits}g}")
