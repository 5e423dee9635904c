"""Trim voltages of a record: told to an observer that goes through all of it, or the part in which they stand still.

What looks at a record in stretches, or fits a model to it, takes the springs as constant.  So it is given the longest
part between two changes, and a bench whose springs are softened as they were there.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Observer
from estimator.trims import Electrode
from hil.bench import Bench
from hil.records.capture import Capture
from hil.records.trims import Trims

_SETTLED = 10.0  # time constants after a change


class AtRest(NamedTuple):
    """A record and its bench, as far as the voltages stand still; what is to be said of it, "" for nothing."""

    captured: Capture
    bench: Bench
    told: str = ""


def at_rest(captured: Capture, bench: Bench, trims: Trims | None) -> AtRest:
    """The longest part of a record in which the trim voltages stand still, and the bench with the springs there."""
    if trims is None or not len(trims) or not len(captured):
        return AtRest(captured, bench)
    first, last = captured.ends
    settling = int(_SETTLED * max(one["settling_s"] for one in trims.outputs) * captured.tick_rate_Hz) + 1
    bounds = np.append(trims.columns["acted_tick"], last + 1)
    # The first row is that of the start, at 0 V: nothing has to settle.
    moved = np.any(np.diff(trims.volts, axis=0, prepend=0.0), axis=1)
    begins = np.maximum(bounds[:-1] + np.where(moved, settling, 0), first)
    longest = int(np.argmax(np.minimum(bounds[1:], last + 1) - begins))
    part = captured.between(int(begins[longest]), int(bounds[longest + 1]) - 1)
    softened = trims.volts[longest] ** 2 @ np.array([one.softening for one in electrodes_of(bench, trims)])
    springs = np.array(bench.device.stiffness_N_per_m) - softened * bench.device.mass_kg
    target = bench.target_stiffness_per_s2 * bench.device.mass_kg
    if bench.trim.control and bench.controller.target_stiffness_N_per_m is None:
        bench = bench.with_(controller={"target_stiffness_N_per_m": target})
    told = ""
    if len(part) < len(captured):
        begin_s, end_s = (tick / captured.tick_rate_Hz for tick in part.ends)
        told = f"the trim voltages are constant from {begin_s:.3f} to {end_s:.3f} s; only that part was used"
    return AtRest(part, bench.with_(device={"stiffness_N_per_m": tuple(map(float, springs))}), told)


def declared_electrodes(bench: Bench, settling_s: Sequence[float]) -> list[Electrode]:
    """Those of the bench file, with the time constants that a board tells of them."""
    trim, mass = bench.trim, bench.device.mass_kg
    each = trim.softening_u if len(trim.softening_u) > 1 else trim.softening_u * len(trim.electrodes)
    found = []
    for row, u, settling in zip(trim.softening_N_per_m_per_V2, each, settling_s, strict=True):
        xx, yy, xy = (value / mass for value in row)
        found.append(Electrode((xx, yy, xy), (u * abs(xx), u * abs(yy), u * abs(xy)), settling))
    return found


def electrodes_of(bench: Bench, trims: Trims) -> Sequence[Electrode]:
    """The electrodes of a record, with the coefficients of the bench file where it declares them."""
    declared = dict(zip(bench.trim.electrodes, bench.trim.softening_N_per_m_per_V2, strict=True))
    found = []
    for one in trims.outputs:
        recorded = np.array(one["softening_per_s2_per_V2"])
        row = declared.get(one["name"])
        softening = recorded if row is None else np.array(row) / bench.device.mass_kg
        found.append(Electrode(tuple(softening), tuple(one["softening_u_per_s2_per_V2"]), one["settling_s"]))
    return found


class Acts:
    """What a record's observer has to be told, and when: the changes of its trims in the order of their samples."""

    def __init__(self, observer: Observer, bench: Bench, trims: Trims | None, rate_Hz: float) -> None:
        self._observer, self._trims, self._rate_Hz, self._next = observer, trims, rate_Hz, 0
        if trims is not None:
            observer.declare_trims(electrodes_of(bench, trims))

    def due(self, tick: NDArray[np.int64]) -> list[tuple[int, "partial[None]"]]:
        """(row, act) before the samples of `tick`, which follow those that this was last asked for."""
        acts: list[tuple[int, partial[None]]] = []
        while self._trims is not None and self._next < len(self._trims):
            row = self._next
            at = int(self._trims.tick[row])
            if at > tick[-1]:
                break
            acts.append((int(np.searchsorted(tick, at)), partial(self._put, self._trims, row)))
            self._next += 1
        return acts

    def _put(self, trims: Trims, row: int) -> None:
        late_s = (int(trims.tick[row]) - 1 - int(trims.columns["acted_tick"][row])) / self._rate_Hz
        for k, volts in enumerate(trims.volts[row]):
            if volts != self._observer.trims.target_V(k):
                self._observer.trims.put(k, float(volts), max(late_s, 0.0))
