"""What trim electrodes came to in a run: figures of result.json."""

import numpy as np

from hil.records.result import Told
from hil.records.runfolder import RunFolder


def told_of(folder: RunFolder, amplitude_m: float) -> list[Told]:
    """What trimming came to: the voltages at the end beside their limits, split and cross stiffness of the springs and
    the drive that they need, before the first change and at the end.
    """
    trims, estimates = folder.trims, folder.estimates
    if trims is None or not len(trims) or estimates is None or not len(estimates):
        return []
    told = [
        Told(name=f"trim {one['name']}", value=float(volts), unit="V", limit=float(one["most_V"]))
        for one, volts in zip(trims.outputs, trims.volts[-1], strict=True)
    ]
    target = float(estimates.header["target_stiffness_per_s2"])
    first = int(trims.tick[1]) if len(trims) > 1 else int(trims.tick[0])
    rows = max(len(estimates.between(0, first)), 1) - 1, len(estimates) - 1
    for when, row in zip(("at first", "at the end"), rows, strict=True):
        part = estimates.part(row, row + 1)
        kxx, kyy, kxy = (float(part[name][0]) for name in ("kxx_per_s2", "kyy_per_s2", "kxy_per_s2"))
        drive = amplitude_m * float(np.linalg.norm([[kxx - target, kxy], [kxy, kyy - target]], 2))
        told += [
            Told(name=f"split of the springs {when}", value=(kxx - kyy) / target, unit="1"),
            Told(name=f"cross stiffness {when}", value=kxy / target, unit="1"),
            Told(name=f"drive for the springs {when}", value=drive, unit="m/s²"),
        ]
    return told
