"""Whether the model accounts for the record."""

import shlex
from collections.abc import Sequence

from hil.bench import Bench
from hil.inputs.swing import swing_slip
from hil.numbers import COVERAGE, typeset
from hil.records.result import Part, Reason, Result
from hil.records.runfolder import RunFolder
from hil.records.sensing import SenseFault, sense_faults

_QUIET = 0.1


def faults_of(folder: RunFolder, bench: Bench) -> list[SenseFault]:
    """What the record of a run says of its sense chain."""
    return [] if folder.capture is None else sense_faults(folder.capture, bench.device.sense.noise_V)


def judge_model(
    folder: RunFolder, result: Result, bench: Bench, faults: Sequence[SenseFault] = (), *, ended_early: bool = False
) -> Part:
    """What is wrong with the sense chain, the closing scan's answer, and the innovation beside its floor.

    A run that did not end early and was over before anything was scored has failed.
    """
    scan, innovation, settle_s = result.scan, folder.innovation, bench.loop.settle_s
    scored = innovation is not None and len(innovation) > 0 and len(innovation.settled(settle_s)) > 0
    if innovation is not None and not scored and not ended_early:
        return Part(
            outcome="failed",
            reason=f"nothing was scored: the record ends before [loop] settle_s = {settle_s:g} s; record for longer, "
            "or lower it",
        )
    reasons = [Reason(scan.reason, trace_command(folder))] if scan is not None and scan.complete is False else []
    if told := innovation_above(result, bench):
        reasons.append(Reason(f"{told}: the model lacks something"))
    elif scored and result.residual_ratio is None:
        told = "the innovation is not finite: the observer diverged; check the signs and gains in [device]"
        reasons.append(Reason(told))
    if folder.capture is not None and (reasons or _silent(result)) and (told := swing_slip(folder.capture, bench)):
        # The rest follows from it.
        return Part(outcome="lacks", reason=told, next=told.rpartition("; ")[2])
    reasons = [*(Reason(fault.text, fault.cure) for fault in faults), *_sample_rate(result, bench), *reasons]
    if not reasons and scan is not None:
        return Part(outcome="unknown" if scan.complete is None else "complete", reason=scan.reason)
    return Part.of(reasons, good="complete", bad="lacks")


def _sample_rate(result: Result, bench: Bench) -> list[Reason]:
    """Whether the board samples at another rate than it says, [effects.clock_rate] included, by more than its clock is
    uncertain by.
    """
    found = None if result.board_clock is None else result.board_clock.sample_rate
    if found is None:
        return []
    delta = bench.effects.named.get("clock_rate", {}).get("delta", 0.0)
    off_ppm = 1e6 * (found.measured_Hz / found.declared_Hz * (1.0 + delta) - 1.0)
    allowed_ppm = 1e6 * COVERAGE * bench.device.known["clock"].u
    if abs(off_ppm) <= allowed_ppm + found.uncertainty_ppm:
        return []
    measured = f"{found.measured_Hz:.7g}"
    off = f"{typeset(f'{off_ppm:+.1f}')} ± {found.uncertainty_ppm:.1f} ppm"
    told = (
        f"the board samples at {measured} Hz by the host's clock, IDENTITY says {found.declared_Hz:g} Hz: {off}, where "
        f"its clock may be off by {allowed_ppm:.3g} ppm (k = 2)"
    )
    declared = f"[effects.clock_rate] delta = {found.declared_Hz / found.measured_Hz - 1.0:.4g}"
    return [Reason(told, f"correct the firmware's tick_rate_Hz to {measured}, or declare {declared}")]


def innovation_above(result: Result, bench: Bench) -> str:
    """By how much the innovation is above its limit; "" where it is not, or is not known."""
    ratio, limit = result.residual_ratio, bench.limits.innovation_ratio
    if ratio is None or not ratio > limit:
        return ""
    return f"innovation {ratio:.3g} × the noise floor, [limits] innovation_ratio is {limit:g}"


def _silent(result: Result) -> bool:
    """Whether the innovation is far below its noise floor, as no sensor is quieter than its noise."""
    return bool(result.innovation_rms and result.noise_floor and result.innovation_rms < _QUIET * result.noise_floor)


def trace_command(folder: RunFolder) -> str:
    """What names the missing effect exactly, ready to paste."""
    return f"hil trace {shlex.quote(str(folder.path))} --bench {shlex.quote(str(folder.bench_path))}"
