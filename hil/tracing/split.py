"""Which part of a record is traced, and from which row on it is held out."""

from dataclasses import dataclass

import numpy as np

from estimator.errors import ModelError
from estimator.record import Record
from estimator.settings import Device
from estimator.trace.fitness import moves_until, require_length
from hil.records.capture import Capture

FRACTION = 0.6
"""Share of a record that is fitted, where it does not say so itself; the rest is held out."""


@dataclass(frozen=True)
class Part:
    """A part of a capture, its samples, the first sample of them that is held out, and what was left out, in words."""

    captured: Capture
    record: Record
    split: int
    said: tuple[str, ...] = ()


def parts_of(captured: Capture, fraction: float | None) -> tuple[Capture, int]:
    """The part of a record to be traced, and its first row that is held out."""
    segments = captured.segments
    if fraction is None and "train" in segments:
        start, stop = segments["train"]
        following = [end for first, end in segments.values() if first == stop]
        if following:
            return captured.part(start, max(following)), stop - start
    held_out = round((FRACTION if fraction is None else fraction) * len(captured))
    return captured, min(max(held_out, 1), len(captured) - 1)


def sample_of(captured: Capture, row: int) -> int:
    """The sample of `hil.inputs.captured.record_of` that is this row: there is one a tick."""
    return int(captured.tick[row] - captured.tick[0])


def moving(part: Part, device: Device) -> Part:
    """`part` without what follows when a free response has come to rest, where the part held out would be all of that.

    Friction, damping and stiffness all predict that a mass at rest stays there: such a part could contradict nobody.
    Where too little would be left, `part` stays as it is.
    """
    until = moves_until(part.record, device)
    if until > part.split:
        return part
    whole = part.captured
    rows = int(np.searchsorted(whole.tick - whole.tick[0], until))
    captured, held_out = parts_of(whole.part(0, rows), FRACTION)
    record, split = part.record.part(slice(0, until)), sample_of(captured, held_out)
    try:
        require_length(record, device, split)
    except ModelError:
        return part
    rest = len(part.record) - until
    said = (
        f"the motion has come to rest at {record.time[-1]:.4g} s: the {rest} samples after that are not used, "
        "since every law predicts that a mass at rest stays there; --fraction uses them"
    )
    return Part(captured, record, split, (*part.said, said))
