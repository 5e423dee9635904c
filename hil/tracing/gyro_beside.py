"""The commercial gyro that was recorded beside a run, as the rate that a trace is scored against."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.record import Record
from hil.records.capture import Capture
from hil.records.runfolder import RunFolder
from hil.scoring.reference import reference_rate


def with_gyro(record: Record, captured: Capture, place: Path) -> tuple[Record, tuple[str, ...]]:
    """A record, a row a tick from the first of `captured` on, with the gyro of its run at `place` where it has one and
    no rate of its own; what there is to say of it.
    """
    folder = RunFolder(place.parent)
    if record.reference is not None or place.name != "capture.arrow" or not folder.reference_path.exists():
        return record, ()
    found = reference_rate(folder)
    if isinstance(found, str):
        return record, (f"reference: not used: {found}",)
    t_s = (captured.tick[0] + np.arange(len(record))) / captured.tick_rate_Hz
    if found.t_s[0] > t_s[0] or found.t_s[-1] + found.step_s < t_s[-1]:
        return record, ("reference: not used: it does not cover the record",)
    held = found.rate_rad_s[np.searchsorted(found.t_s, t_s, side="right") - 1]
    said = "reference: errors are against the gyro beside the run, less its own bias, scale and delay"
    return replace(record, channels={**record.channels, "gyro": held}), (said,)
