"""Whether the reported angle is worth what the bench file asks of it."""

import math
import shlex
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from hil.bench import Bench
from hil.bench.classic import CLASSIC
from hil.bench.loop import LEAST_ROWS
from hil.inputs.declared import formula_of
from hil.numbers import COVERAGE, counted, percent, quantity, signed
from hil.records.estimates import Estimates
from hil.records.result import Contribution, Part, Reason, Result
from hil.records.runfolder import RunFolder
from hil.records.sensing import SenseFault
from hil.verdict.budget import LACKING, UNDECLARED, largest_source
from hil.verdict.model import innovation_above, trace_command
from hil.verdict.uncertainty import DAMPING, ESTIMATION

_OPEN_LOOP = (
    "no angle to judge: {why}; run with the control law on for one, or with "
    '[observer] variant = "sense", which integrates the rate'
)
_BEYOND = 2.0
"""Expanded uncertainties, four standard ones: an honest angle is off by more in one run of 16 000."""
_UNTOLD = "the observer gives no uncertainty of its angle (angle_u); hil score with a truth shows its error"
_NOT_RECORDED = "no angle to judge: no estimates were recorded"
_NO_PATTERN = "no angle to judge: a single axis has none"
_TOO_FEW = "no angle to judge: {rows} of estimates in the scored window, at least {least} are needed"
_FROM_ELSEWHERE = "no angle to judge: an imported record without control is judged by its model"


def judge_angle(folder: RunFolder, result: Result, bench: Bench, faults: Sequence[SenseFault] = ()) -> Part:
    """Share of the scored window at which energy and quadrature were outside their limits, and the expanded uncertainty
    at its end, unless something is wrong that it knows nothing of.

    A run that was asked for no angle is not judged by it. One of whose angle nobody knows what it is worth has failed
    in that part; so has one whose angle is off by more than it says, where the truth was told, or does not go where its
    own rate goes, one of a plug-in that is not what the bench's own observer reads, and a board whose own estimates are
    not the host's.
    """
    estimates, limits = folder.estimates, bench.limits
    if estimates is None or "energy_ratio" not in estimates:
        return Part(outcome="unknown", reason=_NOT_RECORDED if estimates is None else _NO_PATTERN)
    if estimates.header.get("angle") == "none":
        ran = folder.capture is None or folder.capture.header.get("identity") is not None
        return Part(outcome="unknown", reason=_OPEN_LOOP.format(why=formula_of(bench).why) if ran else _FROM_ELSEWHERE)
    scored = estimates.settled(bench.loop.settle_s)
    if len(scored) < LEAST_ROWS:
        return Part(outcome="unknown", reason=_TOO_FEW.format(rows=counted(len(scored), "row"), least=LEAST_ROWS))
    expanded = result.angle_expanded_rad
    doubts = [] if expanded is None else _doubts(folder, result, bench, faults, float(scored.part(0, 1).t_s[0]))
    reasons = [*doubts]
    if estimates.header.get("angle") != "rate":  # the integrated rate needs no slender ellipse
        outside = np.zeros(3)
        for piece in scored.pieces():
            held = np.abs(piece["energy_ratio"] - 1.0) <= limits.energy_error  # NaN is not held either
            held |= not bench.controller.enabled and np.isfinite(piece["energy_ratio"])  # nothing is to hold it
            slender = np.abs(piece["quadrature_ratio"]) <= limits.quadrature
            outside += [np.count_nonzero(~mask) for mask in (held & slender, held, slender)]
        invalid, off, oval = (float(share) for share in outside / len(scored))
        if invalid > limits.invalid_fraction:
            told = (
                f"the angle was not valid {percent(invalid, 2)} of the time (energy off target {percent(off, 2)}, "
                f"quadrature too large {percent(oval, 2)}), [limits] invalid_fraction is "
                f"{percent(limits.invalid_fraction, 2)}"
            )
            reasons.append(Reason(told, _held_by(folder, bench, "energy" if off >= oval else "quadrature")))
    error = None if result.score is None else result.score.angle_error_end_rad
    if expanded is not None and (contradicted := _contradicted(result, scored, expanded)):
        told = f"the truth contradicts the angle: {contradicted}, and uncertain by {_angle(expanded)}"
        reasons.append(Reason(f"{told} (k = 2) at the end"))
    reasons += _against_rate(scored, expanded or 0.0)
    reasons += [] if doubts else _against_own_reading(folder, result)
    reasons += _on_board(folder, result, scored, bench)
    if expanded is not None and expanded > limits.angle_rad and not doubts:
        largest = result.uncertainty[0]
        told = (
            f"the angle is uncertain by {_angle(expanded)} (k = 2), [limits] angle_rad is {limits.angle_rad:g}; "
            f"largest source: {largest_source(largest)}"
        )
        reasons.append(Reason(told, remedy(largest, bench).text))
    if not reasons and expanded is None and _untold(scored):
        return _by_truth(error, limits.angle_rad)
    if not reasons and expanded is None:
        return Part(outcome="failed", reason="the angle's uncertainty is not finite: the observer diverged")
    part = Part.of(reasons)
    if not reasons:
        assert expanded is not None
        return part.model_copy(update={"reason": f"uncertain by {_angle(expanded)} (k = 2) at the end"})
    return part


def _held_by(folder: RunFolder, bench: Bench, what: str) -> str:
    """Where to look for why energy or quadrature was not held: in what drives, and in what it goes by."""
    if bench.loop.mode == "board":
        return f"write the board's estimator from this bench file: hil generate {shlex.quote(str(folder.bench_path))}"
    law = "plugin" if bench.controller.plugin is not None else f"{what}_gain"
    return f"check [device] mass_kg, the gains of sense and drive, and [controller] {law}"


def _doubts(
    folder: RunFolder, result: Result, bench: Bench, faults: Sequence[SenseFault], scored_s: float
) -> list[Reason]:
    """What the uncertainty of the angle has no row for: a sense chain that failed while it was scored, or a record that
    the model does not predict, of which the scan could name nothing.
    """
    found = [Reason(fault.text, fault.cure) for fault in faults if fault.voids and fault.until_s >= scored_s]
    if not found and not (result.scan and result.scan.lacks) and (told := innovation_above(result, bench)):
        found = [Reason(told, trace_command(folder))]
    return [Reason(f"its uncertainty does not hold: {reason.text}", reason.cure) for reason in found]


def _contradicted(result: Result, scored: Estimates, expanded_rad: float) -> str:
    """By how much the angle is off where the truth says that it is off by more than its uncertainty: rms since its
    zero, or at the end, which is one instant of many; "" where it is not.
    """
    if result.score is None:
        return ""
    rms, last = result.angle_error_rms_rad, result.score.angle_error_end_rad
    if rms is not None and rms > _expanded_rms(scored, expanded_rad):
        return f"it is off by {_angle(rms)} rms"
    return f"at the end it is off by {_angle(last)}" if last is not None and last > _BEYOND * expanded_rad else ""


def _expanded_rms(scored: Estimates, expanded_rad: float) -> float:
    """Expanded uncertainty over the scored window [rad], rms: that of the end, or more where the angle was less certain
    before it, as a reversal makes it.
    """
    last = scored.part(len(scored) - 1, len(scored))
    if "angle_u_rad" not in scored or not last["angle_u_rad"][0] > 0.0:
        return expanded_rad
    mean = sum(float(np.sum(piece["angle_u_rad"] ** 2)) for piece in scored.pieces()) / len(scored)
    return expanded_rad * float(np.fmax(math.sqrt(mean) / last["angle_u_rad"][0], 1.0))


_TURN_RAD = 0.5 * math.pi
"""A quarter of a turn: an angle that turns less is not held against its rate, whose bias may add up to as much."""


def _against_rate(scored: Estimates, expanded_rad: float) -> list[Reason]:
    """Whether the angle goes elsewhere than the integral of the same observer's rate: further from it, where they are
    farthest apart, than half of the longer way. Closer may be a rate's bias and noise, for which as much counts as its
    deviation would add up to if all of it were bias.
    """
    if "angle_rate_integral_rad" not in scored or scored.header.get("angle") == "rate":
        return []
    names = ("angle_rad", "angle_rate_integral_rad")
    start = np.array([scored.part(0, 1)[name] for name in names])
    low, high, farthest, bias_rad = start[:, 0] * 0.0, start[:, 0] * 0.0, start[:, 0] * 0.0, 0.0
    rate_sd = "rate_rad_s" in scored.states
    for piece in scored.pieces():
        gone = np.stack([piece[name] for name in names]) - start
        low, high = np.fmin(low, gone.min(axis=1)), np.fmax(high, gone.max(axis=1))
        at = int(np.argmax(np.abs(gone[0] - gone[1])))
        if abs(gone[0, at] - gone[1, at]) > abs(farthest[0] - farthest[1]):
            farthest = gone[:, at]
        bias_rad += COVERAGE * float(np.nansum(piece.sd("rate_rad_s"))) if rate_sd else 0.0
    seconds = scored.ends_s[1] - scored.ends_s[0]
    allowed = max(0.5 * float((high - low).max()), math.hypot(expanded_rad, bias_rad * seconds / len(scored)))
    if high[0] - low[0] < _TURN_RAD or not abs(farthest[0] - farthest[1]) > allowed:
        return []
    angle, integral = (f"{signed(float(value))} rad" for value in farthest)
    told = f"the angle goes {angle} where the integral of the rate goes {integral}: a wrong sign, or degrees"
    return [Reason(told)]


def _against_own_reading(folder: RunFolder, result: Result) -> list[Reason]:
    """Whether a plug-in's angle is what the bench's own observer reads of the same record, to within what both are
    uncertain by; where the model lacks nothing, else neither is known to be right.
    """
    own, expanded = result.own_reading, result.angle_expanded_rad
    if own is None or expanded is None or result.scan is None or result.scan.complete is not True:
        return []
    allowed = math.hypot(expanded, own.own_expanded_rad)
    if abs(own.plugin_rad - own.own_rad) <= allowed:
        return []
    told = (
        f"the plug-in's angle goes {signed(own.plugin_rad)} rad where the bench's own observer reads "
        f"{signed(own.own_rad)} rad of the same record; they are uncertain by {_angle(allowed)} (k = 2) together"
    )
    return [Reason(told, f"hil compare {shlex.quote(str(folder.path))}")]


def _on_board(folder: RunFolder, result: Result, scored: Estimates, bench: Bench) -> list[Reason]:
    """Whether the board's own estimates are the host's, to within what both are uncertain by; the angle of a board that
    gives no uncertainty, within its limit.
    """
    found, board = result.board, folder.board_estimates
    if found is None or board is None or found.valid_fraction is None:
        return []
    invalid = 1.0 - found.valid_fraction
    apart: list[str] = []
    said = board.settled(folder.settle_s)
    own, own_rate = (COVERAGE * _rms(said, name) for name in ("angle_sd_rad", "sd_rate_rad_s"))
    if (expanded := result.angle_expanded_rad) is not None:
        for size, u, when in (
            (found.angle_difference_end_rad, expanded, "at the end"),
            (found.angle_difference_rms_rad, _expanded_rms(scored, expanded), "rms"),
        ):
            allowed = math.hypot(u, own) if own else max(u, bench.limits.angle_rad)
            if size is not None and size > allowed and not apart:
                limit = f"uncertain by {_angle(allowed)} (k = 2)"
                limit = limit if own else f"with no uncertainty of it, [limits] angle_rad is {bench.limits.angle_rad:g}"
                apart.append(f"the angle by {_angle(size)} {when}, {limit}")
    rate = found.rate_difference_rms_rad_s
    u = math.hypot(COVERAGE * _rms(scored, "sd_rate_rad_s"), own_rate)
    if rate is not None and rate > u > 0.0:
        by, limit = (quantity(each, "rad/s", 2) for each in (rate, u))
        apart.append(f"the rate by {by} rms, uncertain by {limit} (k = 2)")
    reasons = [Reason(f"the board's own estimates are not the host's: {'; '.join(apart)}")] if apart else []
    if invalid > bench.limits.invalid_fraction:
        told = f"the board calls its own angle not valid {percent(invalid, 2)} of the time"
        limit = percent(bench.limits.invalid_fraction, 2)
        reasons.append(Reason(f"{told}, [limits] invalid_fraction is {limit}"))
    return reasons


def _rms(scored: Estimates, name: str) -> float:
    """Of a deviation over these rows; 0 where it is not given."""
    squares = 0.0 if name not in scored else sum(float(np.nansum(piece[name] ** 2)) for piece in scored.pieces())
    return math.sqrt(squares / max(len(scored), 1))


def _untold(scored: Estimates) -> bool:
    """Whether the observer is one that tells no uncertainty of its angle, which it has."""
    if "observer" not in scored.header.get("plugins", {}):
        return False
    return all(
        bool(np.isfinite(piece["angle_rad"]).all() and np.isnan(piece["angle_sd_rad"]).all())
        for piece in scored.pieces()
    )


def _by_truth(error_rad: float | None, limit_rad: float) -> Part:
    """What an angle without an uncertainty is worth: nobody knows, unless the truth was told."""
    if error_rad is None:
        return Part(outcome="unknown", reason=_UNTOLD)
    told = f"off by {_angle(error_rad)} at the end, by the truth; the observer gives no uncertainty of it"
    if error_rad > limit_rad:
        return Part.of([Reason(f"the angle is {told}, [limits] angle_rad is {limit_rad:g}")])
    return Part.of([]).model_copy(update={"reason": told})


def _angle(size_rad: float) -> str:
    return quantity(size_rad, "rad", 2)


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
        turned = 0.5 * math.hypot(0.5 * (xx - yy), xy, bench.damping_sd_per_s)
        turned *= bench.loop.duration_s - bench.loop.settle_s
        if turned > math.sqrt(0.5) * row.contribution_rad:  # most of the variance
            return Remedy(
                'set [controller] mode = "whole_angle", which estimates the damping, and run again',
                {"controller": {"mode": "whole_angle"}},
            )
        if bench.controller.mode == "mode_reversal":
            return Remedy(
                'set [controller] mode = "whole_angle", which never holds the rate, and run again',
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
