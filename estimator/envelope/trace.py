"""From the amplitude of a ring-down to the law of its damping: chosen on one part, judged on another."""

import math

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis import Diagnosis
from estimator.envelope.record import FEWEST, Envelope, Resonator
from estimator.envelope.ring_down import RingDown
from estimator.errors import ModelError
from estimator.trace.output_trace import trace_output

Rows = NDArray[np.bool_]

BLOCK = 4
"""Samples of a block: what is large at the beginning of a ring-down has died away at its end."""


def by_turns(samples: int) -> Rows:
    """True for what is fitted, where a record has no split of its own: three blocks of every five."""
    return np.asarray(np.arange(samples) // BLOCK % 5 < 3)


def trace_envelope(envelope: Envelope, resonator: Resonator, fitting: Rows) -> Diagnosis:
    """Find what linear damping lacks on the rows `fitting` and score it on the others.

    Raises ModelError where one of the two parts is too small, or the amplitude does not fall.
    """
    for rows, part in ((fitting, "fitted"), (~fitting, "held out")):
        if int(np.sum(rows)) < FEWEST // 2:
            raise ModelError(f"the part to be {part} has {int(np.sum(rows))} samples; at least {FEWEST // 2}")
    told, noise = np.flatnonzero(fitting), resonator.noise
    floor = noise, math.inf, "the declared noise"
    return trace_output(RingDown(envelope, resonator, told=told, counted=told, noise=noise, floor=floor), fitting)
