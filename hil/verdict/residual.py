"""What to look for, or to set, where the innovation stopped a run while its observer was still finding the motion."""

import math
import shlex

import numpy as np

from hil.bench import Bench
from hil.bench.classic import CLASSIC
from hil.boards.emulation import is_emulated
from hil.records.result import Reason
from hil.records.runfolder import RunFolder


def cause(folder: RunFolder, bench: Bench, link: str) -> Reason | None:
    """One clause and what to do; None of a run that was stopped after [loop] settle_s: what is wrong there is not its
    start.
    """
    innovation = folder.innovation
    if innovation is None or not len(innovation) or len(innovation.settled(bench.loop.settle_s)):
        return None
    if bench.observer.plugin is None:
        return _wiring(folder, bench, link)
    largest = max(float(np.nanmax(np.abs(piece.nu_V), initial=0.0)) for piece in innovation.pieces())
    noise = bench.device.sense.noise_V
    limit = _above(max(largest, *bench.swing_V) / noise)
    told = f"the largest was {largest / noise:.0f} ×"
    if bench.controller.mode in CLASSIC:
        cure = f"set [limits] residual_safe = {limit:g}"
        return Reason(f"{told}, of a motion that the loops still had to find: {cure}", cure)
    cure = (
        f"if the plug-in needs longer to find the motion, set [observer] acquisition_s to that time, else [limits] "
        f"residual_safe = {limit:g}"
    )
    return Reason(f"{told}, before [loop] settle_s: {cure}", cure)


def _wiring(folder: RunFolder, bench: Bench, link: str) -> Reason:
    """Of the bench's own observer, which finds any motion of a device as declared."""
    drives = ", or the signs that the board's estimator has" if bench.loop.mode == "board" else ""
    told = f"before [loop] settle_s this is most often wiring: a sign, exchanged channels, a scale{drives}"
    like = shlex.quote(str(folder.bench_path))
    armed = "" if is_emulated(link) else " --arm"
    return Reason(told, f"hil identify {shlex.quote(link)} --like {like} --mass {bench.device.mass_kg:g}{armed}")


def _above(size: float) -> float:
    """The next number of two digits."""
    step = 10.0 ** (math.floor(math.log10(size)) - 1)
    return math.ceil(size / step) * step
