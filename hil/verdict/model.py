"""Whether the model accounts for the record."""

from hil.bench import Bench
from hil.records.result import Part, Result
from hil.records.runfolder import RunFolder
from hil.records.sensing import sense_faults


def judge_model(folder: RunFolder, result: Result, bench: Bench) -> Part:
    """The innovation beside its floor, and what the codes say of the sense chain."""
    limits, reasons = bench.limits, []
    if result.innovation_rms is not None and result.noise_floor:
        ratio = result.innovation_rms / result.noise_floor
        if ratio > limits.innovation_ratio:
            reasons.append(
                f"innovation {ratio:.3g} × the noise floor, [limits] innovation_ratio is "
                f"{limits.innovation_ratio:g}: the model lacks something"
            )
    elif folder.innovation is not None and len(folder.innovation.since(bench.loop.settle_s)):
        reasons.append("the innovation is not finite: the observer diverged; check the signs and gains in [device]")
    if folder.capture is not None:
        reasons += sense_faults(folder.capture, bench.device.sense.noise_V)
    return Part.of(reasons, good="complete", bad="lacks")
