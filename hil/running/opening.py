"""The first rows of a run, kept in memory: before the first drive they tell sense levels, after the run signs."""

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from estimator.observer import Observer
from hil.bench import Bench
from hil.running.levels import Levels
from hil.running.signs import samples_needed, wrong_way
from hil.wire.messages import Identity


class Opening:
    """Told rows (tick, vx, vy, ux, uy, …) until it has as many as it needs.

    Attributes:
        judged: whether there were enough rows to tell the sense levels by.
        wrong: what is wrong with the sense levels, "" while that is nothing or not known yet.
    """

    def __init__(self, bench: Bench, identity: Identity) -> None:
        self._bench = bench
        self._scale = np.array([identity.sense_scale_V] * 2 + [identity.drive_scale_mps2] * 2)
        self._end = 2 ** (identity.sense_bits - 1) - 1
        self._levels = Levels(bench, identity)
        self._needed = max(self._levels.rows, samples_needed(bench))
        self._rows: list[Sequence[int]] = []
        self.judged = False
        self.wrong = ""

    @property
    def lacking(self) -> int:
        """Rows until there are as many as the next judgement needs, at least one."""
        return max((self._needed if self.judged else self._levels.rows) - len(self._rows), 1)

    def saw(self, rows: Iterable[Sequence[int]]) -> bool:
        """Note the next rows; whether they were the last that are needed."""
        self._rows.extend(rows)
        if not self.judged and len(self._rows) >= self._levels.rows:
            self.judged = True
            self.wrong = self._levels.wrong(np.array([row[1:3] for row in self._rows]))
        return len(self._rows) >= self._needed

    def wrong_way(self, make_observer: Callable[[], Observer]) -> str:
        """As `hil.running.signs.wrong_way`, for what came of the run so far."""
        if len(self._rows) < 2:
            return ""
        rows = np.array([row[:5] for row in self._rows])
        clipped = np.flatnonzero((np.abs(rows[:, 1:3]) >= self._end).any(axis=1))
        if len(clipped):  # from there on the samples are not what the device did
            rows = rows[: clipped[0]]
        if len(rows) < 2:
            return ""
        at = rows[:, 0] - rows[0, 0]
        if at[-1] >= 2 * self._needed:  # more gap than record
            return ""
        si = np.full((int(at[-1]) + 1, 4), math.nan)
        si[:, 2:] = 0.0
        si[at] = rows[:, 1:] * self._scale
        return wrong_way(self._bench, make_observer, si[:, :2], si[:, 2:])
