"""What to set where the innovation stopped a run while its observer was still finding the motion."""

import math

import numpy as np

from hil.bench import Bench
from hil.bench.classic import CLASSIC
from hil.records.runfolder import RunFolder


def cure(folder: RunFolder, bench: Bench) -> str:
    """One clause that names the keys and their values; "" of the bench's own observer, and of a run that was stopped
    after [loop] settle_s: what is wrong there is not its start.
    """
    innovation = folder.innovation
    if bench.observer.plugin is None or innovation is None or not len(innovation):
        return ""
    if len(innovation.settled(bench.loop.settle_s)):
        return ""
    largest = max(float(np.nanmax(np.abs(piece.nu_V), initial=0.0)) for piece in innovation.pieces())
    noise = bench.device.sense.noise_V
    limit = _above(max(largest, *bench.swing_V) / noise)
    told = f"the largest was {largest / noise:.0f} ×"
    if bench.controller.mode in CLASSIC:
        return f"{told}, of a motion that the loops still had to find: set [limits] residual_safe = {limit:g}"
    return (
        f"{told}, before [loop] settle_s: if the plug-in needs longer to find the motion, set [observer] acquisition_s "
        f"to that time, else [limits] residual_safe = {limit:g}"
    )


def _above(size: float) -> float:
    """The next number of two digits."""
    step = 10.0 ** (math.floor(math.log10(size)) - 1)
    return math.ceil(size / step) * step
