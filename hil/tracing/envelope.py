"""Judge a ring-down whose amplitude was recorded (`[device.sense] senses = "envelope"`): its law of damping."""

from pathlib import Path

import numpy as np

from estimator.diagnosis import Diagnosis
from estimator.envelope.record import Envelope
from estimator.errors import ModelError
from hil.bench import Bench
from hil.errors import InputError
from hil.inputs.declared import resonator_of
from hil.records.capture import Capture


def trace_ring_down(place: Path, captured: Capture, bench: Bench, split: int | None) -> tuple[Envelope, Diagnosis]:
    """The record at `place` as an envelope, and what linear damping lacks on it.

    split: the first row that is held out; None: blocks are, by turns.  Raises InputError for a record that is none of a
    ring-down's amplitude, or too short.
    """
    from estimator.envelope.trace import by_turns, trace_envelope  # SymPy

    if captured.has_drive and np.any(captured.drive):
        raise InputError(f"{place}: a drive beside an envelope; an envelope is that of a free ring-down, leave it out")
    if captured.noise_gain != 1.0:
        raise InputError(f"{place}: an envelope behind a filter of its map; leave out [filter]")
    try:
        envelope = Envelope(
            np.asarray(captured.t_s - captured.t_s[0]), captured.sense_V[:, 0], bench.device.sense.is_in_decibels
        )
        fitting = by_turns(len(captured)) if split is None else np.arange(len(captured)) < split
        return envelope, trace_envelope(envelope, resonator_of(bench), fitting)
    except ModelError as error:
        raise InputError(f"{place}: {error}") from None
