"""Whether the model accounts for the record."""

import shlex

from hil.bench import Bench
from hil.inputs.swing import swing_slip
from hil.records.result import Part, Result
from hil.records.runfolder import RunFolder
from hil.records.sensing import sense_faults

_QUIET = 0.1


def judge_model(folder: RunFolder, result: Result, bench: Bench, *, ended_early: bool = False) -> Part:
    """The closing scan's answer, the innovation beside its floor, and what the codes say of the sense chain.

    A run that did not end early and was over before anything was scored has failed.
    """
    limits, scan, reasons = bench.limits, result.scan, []
    innovation, settle_s = folder.innovation, bench.loop.settle_s
    scored = innovation is not None and len(innovation) > 0 and len(innovation.settled(settle_s)) > 0
    if innovation is not None and not scored and not ended_early:
        return Part(
            outcome="failed",
            reason=f"nothing was scored: the record ends before [loop] settle_s = {settle_s:g} s; record for longer, "
            "or lower it",
        )
    if scan is not None and scan.complete is False:
        reasons.append(scan.reason)
    if (ratio := result.residual_ratio) is not None:
        if ratio > limits.innovation_ratio:
            reasons.append(
                f"innovation {ratio:.3g} × the noise floor, [limits] innovation_ratio is "
                f"{limits.innovation_ratio:g}: the model lacks something"
            )
    elif scored:
        reasons.append("the innovation is not finite: the observer diverged; check the signs and gains in [device]")
    if folder.capture is not None and (reasons or _silent(result)) and (told := swing_slip(folder.capture, bench)):
        # The rest follows from it.
        return Part(outcome="lacks", reason=told, next=told.rpartition("; ")[2])
    if folder.capture is not None:
        reasons += sense_faults(folder.capture, bench.device.sense.noise_V)
    if not reasons and scan is not None:
        return Part(outcome="unknown" if scan.complete is None else "complete", reason=scan.reason)
    part = Part.of(reasons, good="complete", bad="lacks")
    if scan is not None and scan.complete is False:
        return part.model_copy(update={"next": trace_command(folder)})
    return part


def _silent(result: Result) -> bool:
    """Whether the innovation is far below its noise floor, as no sensor is quieter than its noise."""
    return bool(result.innovation_rms and result.noise_floor and result.innovation_rms < _QUIET * result.noise_floor)


def trace_command(folder: RunFolder) -> str:
    """What names the missing effect exactly, ready to paste."""
    return f"hil trace {shlex.quote(str(folder.path))} --bench {shlex.quote(str(folder.bench_path))}"
