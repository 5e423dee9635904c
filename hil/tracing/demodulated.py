"""What a trace says of demodulated streams: whether the averaged motion with linear stiffness and damping accounts for
them.  They have no samples within a cycle, so no effect is tried by its name.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator import diagnosis as traced
from estimator.correlation import autocorrelation
from estimator.diagnosis import Diagnosis, Finding, Fit, Verdict
from estimator.envelope.record import Envelope
from estimator.errors import ModelError
from estimator.residual.whiteness import portmanteau
from hil.bench import Bench
from hil.errors import InputError
from hil.inputs.captured import samples_of
from hil.inputs.declared import resonator_of
from hil.plugins.of_bench import recorded_observer
from hil.records.capture import Capture

NOT_TOLD = (
    "demodulated streams have no samples within a cycle: no effect is tried by its name; record the samples for that"
)
_FEWEST = 40
"""Innovations of a part."""
_LAGS, _COLOURED = 20, 0.2
"""Blocks back; an autocorrelation beyond it is something that the model lacks.  The observer's own, whose rate is free
to wander, is less.
"""


def trace_streams(place: Path, captured: Capture, bench: Bench, split: int) -> Diagnosis:
    """The residual of the observer on the rows before `split`, [loop] settle_s left out, and on the rest.  Raises
    InputError for a part that is too short.
    """
    observer, samples = recorded_observer(bench, captured), samples_of(captured)
    found = observer.run(samples.sense, samples.drive, step=samples.step, every=len(samples.tick))
    left, spread = found.innovation, found.innovation_deviation
    taken = np.flatnonzero(np.any(np.diff(left, axis=0, prepend=0.0) != 0.0, axis=1))  # one of each block of rows
    settled = taken[taken >= bench.loop.settle_s * captured.tick_rate_Hz]
    parts = settled[settled < split], settled[settled >= split]
    for rows, name in zip(parts, ("fitted", "held out"), strict=True):
        if len(rows) < _FEWEST:
            raise InputError(f"{place}: {len(rows)} blocks to be {name} behind settle_s; record for longer")
    fits = tuple(_fit(left[rows], spread[rows]) for rows in parts)
    over = [
        f"the innovation of the part {name} is {fit.ratio:.3g} × the declared noise, [limits] innovation_ratio is "
        f"{bench.limits.innovation_ratio:g}"
        for fit, name in zip(fits, ("that was fitted", "held out"), strict=True)
        if fit.ratio > bench.limits.innovation_ratio
    ]
    late = parts[1]
    remembered = max(float(np.max(np.abs(autocorrelation(one)[1:_LAGS]))) for one in (left[late] / spread[late]).T)
    if coloured := remembered > _COLOURED:
        over.append(f"the innovation of the part held out is autocorrelated by {remembered:.2g}")
    size = float(np.sqrt(np.mean(left[late] ** 2)))
    finding = Finding("whiteness", "autocorrelated from one block to the next", size, 0.0)
    return traced.Diagnosis(
        verdict=Verdict.UNEXPLAINED if over else Verdict.ADEQUATE, effects=(), separations=(), rejected=(),
        findings=(finding,) if coloured else (), before=fits[0], after=fits[0], held_out_before=fits[1],
        held_out_after=fits[1], residual_before=left, residual_after=left, split=split,
        reasons=(*over, NOT_TOLD),
    )  # fmt: skip


def _fit(left: NDArray[np.float64], spread: NDArray[np.float64]) -> Fit:
    rms, floor = np.sqrt(np.mean(left**2, axis=0)), np.sqrt(np.mean(spread**2, axis=0))
    white = portmanteau(left / spread, _LAGS).p
    return Fit(tuple(rms), tuple(floor), float(np.sqrt(np.mean((left / spread) ** 2))), white)


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
