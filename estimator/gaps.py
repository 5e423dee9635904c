"""The drive over gaps of a record: the best prediction from the rows around, and what its error adds to the motion.

A row that is missing takes with it the drive that acted up to it.  A wrong drive moves the mass, and a filter that
takes it for the right one finds the cause elsewhere: in a constant, in the rate, in an effect that is not there.  So
the record itself says how well its drive can be predicted: gaps of the same length are made where nothing is missing,
and the drive in them is fitted to the rows around by least squares.  The error of such a prediction is uncorrelated
with what it was made from, so it looks like no effect of the drive; carried through the free oscillation to the end of
the gap, its mean square is the covariance that a gap adds to the motion.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Estimates, Observer
from estimator.scaling import Array
from estimator.spans import spans

ROWS_BEFORE = 2
"""Rows before a gap that tell of its drive; behind it one does."""

_MOST = 3000  # gaps made in the record, of each length
_FEWEST = 8  # of them for each number that is fitted
_LONGEST = 512  # samples
_BLIND = 1e-12  # of the largest eigenvalue: what the record says nothing of
_NOTHING, _ANYTHING = 0, 1  # numbers of spreads

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Gaps:
    """Runs of samples whose drive is a prediction.

    last (g,): the last sample of each; spread (g, 2 axes, 2 axes): covariance of position and velocity, axis by axis,
    that the prediction adds by then, SI; infinite where nothing is known of the drive.
    """

    last: NDArray[np.int64]
    spread: Array

    def __len__(self) -> int:
        return len(self.last)

    @property
    def behind(self) -> NDArray[np.int64]:
        """The first sample behind each gap that adds to the motion: what was before it does not tell of the motion
        there.
        """
        return np.asarray(self.last[np.any(self.spread != 0.0, axis=(1, 2))] + 1)

    def part(self, rows: slice) -> "Gaps":
        """Those that end within the samples of `rows`, counted from its first."""
        begin, end = np.searchsorted(self.last, [rows.start, rows.stop])
        return Gaps(self.last[begin:end] - rows.start, self.spread[begin:end])


@dataclass(frozen=True)
class _Prediction:
    """Coefficients (features, length · axes), and the number of what their error adds to the motion."""

    coefficients: Array
    number: int


class Drives:
    """How the drive of a record goes with the rows around it, learnt where none is missing.

    sense (n, axes) V, NaN where there is none; drive (n, axes); known (n,): whether the drive is; omega: of the
    resonance, rad/s; step: s; gain: force per mass of one unit of the drive, m/s²; held: whether the drive is held from
    sample to sample, without which nothing is known of it in a gap.
    """

    def __init__(
        self, sense: Array, drive: Array, known: Flags, *, omega: float, step: float, gain: float, held: bool = True
    ) -> None:
        self._axes, self._held = drive.shape[1], held
        self._sense, self._drive = sense, drive
        self._omega, self._step, self._gain = omega, step, gain
        # A drive that is off goes by no law.
        self._usable = known & np.all(np.isfinite(sense), axis=1) & np.any(drive != 0.0, axis=1)
        size = 2 * self._axes
        self._spreads = [np.zeros((size, size)), np.full((size, size), math.inf)]  # of _NOTHING and _ANYTHING
        self._predictions: dict[tuple[int, bool, int], _Prediction | None] = {}

    @cached_property
    def _unusable_before(self) -> NDArray[np.int64]:
        return np.concatenate([[0], np.cumsum(~self._usable)])

    def fill(self, sense: Array, drive: Array, known: Flags) -> tuple[Array, NDArray[np.int64]]:
        """The drive (n, axes) of a record, or of part of it, predicted where it is not known; and (n,) what that adds
        to the motion, as a number for `spread`, at the last sample of each gap, 0 elsewhere.

        A drive that is zero on both sides of a gap was off; where it is on one, it was switched in between and nobody
        knows when.
        """
        drive, gap = np.where(known[:, None], drive, 0.0), np.zeros(len(known), np.int64)
        for begin, end in spans(~known):
            if begin > 0 and end < len(known):
                drive[begin:end], gap[end - 1] = self._between(sense, drive, known, begin, end)
        return drive, gap

    def spread(self, numbers: NDArray[np.int64]) -> Array:
        """Covariances (g, 2 axes, 2 axes) of the motion by their numbers."""
        return np.asarray(np.array(self._spreads)[numbers])

    def _between(self, sense: Array, drive: Array, known: Flags, begin: int, end: int) -> tuple[Array, int]:
        length = end - begin
        on = [bool(np.any(drive[row] != 0.0)) for row in (begin - 1, end)]
        if not any(on):
            return np.zeros((length, self._axes)), _NOTHING
        if all(on) and self._held:
            sensed = np.all(np.isfinite(sense[max(begin - ROWS_BEFORE, 0) : begin]), axis=1)
            rows = 1
            while rows < len(sensed) and sensed[-1 - rows] and known[begin - 1 - rows]:
                rows += 1
            prediction = self._prediction(rows, bool(sensed[-1]), length)
            if prediction is not None:
                features = self._features(sense, drive, np.array([begin]), rows, bool(sensed[-1]), length)
                return (features @ prediction.coefficients).reshape(length, self._axes), prediction.number
        straight = np.linspace(drive[begin - 1], drive[end], length + 2)[1:-1]
        return straight, _ANYTHING

    def _prediction(self, rows: int, sensed: bool, length: int) -> _Prediction | None:
        """For gaps of a length, from so many rows before them; None where the record cannot tell."""
        key = rows, sensed, length
        if key not in self._predictions:
            self._predictions[key] = self._learn(rows, sensed, length)
        return self._predictions[key]

    def _learn(self, rows: int, sensed: bool, length: int) -> _Prediction | None:
        if length > _LONGEST:
            return None
        before = self._unusable_before
        starts = np.arange(rows, len(self._usable) - length)
        starts = starts[before[starts + length + 1] == before[starts - rows]]
        fitted = 1 + self._axes * ((2 if sensed else 1) * rows + 1)
        if len(starts) < _FEWEST * fitted:
            return None
        starts = starts[np.linspace(0, len(starts) - 1, min(len(starts), _MOST)).astype(int)]
        features = self._features(self._sense, self._drive, starts, rows, sensed, length)
        within = self._drive[starts[:, None] + np.arange(length)]
        coefficients = _least_squares(features, within.reshape(len(starts), -1))
        error = within - np.einsum("nf,fm->nm", features, coefficients).reshape(within.shape)
        moved = np.einsum("jm,nja->nam", self._pushes(length), error).reshape(len(starts), -1)
        self._spreads.append(np.einsum("ni,nj->ij", moved, moved) / (len(starts) - fitted))
        return _Prediction(coefficients, len(self._spreads) - 1)

    def _features(
        self, sense: Array, drive: Array, starts: NDArray[np.int64], rows: int, sensed: bool, length: int
    ) -> Array:
        """What a prediction is made from (gaps, features): one, the rows before, the drive behind."""
        columns = [np.ones((len(starts), 1)), drive[starts + length]]
        for row in range(1, rows + 1):
            columns.append(drive[starts - row])
            if sensed:
                columns.append(sense[starts - row])
        return np.concatenate(columns, axis=1)

    def _pushes(self, length: int) -> Array:
        """Position and velocity (length, 2) at the end of a gap by one unit of drive over each of its intervals."""
        end = self._omega * self._step * np.arange(length - 1, -1, -1)
        begin = end + self._omega * self._step
        moved = np.column_stack([(np.cos(end) - np.cos(begin)) / self._omega, np.sin(begin) - np.sin(end)])
        return np.asarray(moved * self._gain / self._omega)


def _least_squares(features: Array, values: Array) -> Array:
    """Coefficients (f, m) by normal equations, each feature in units of its size: small sums, for which the threads of
    a BLAS library are worth nothing, and on a busy machine cost much.
    """
    size = np.maximum(np.sqrt(np.mean(features**2, axis=0)), np.finfo(float).tiny)
    scaled = features / size
    normal = np.linalg.pinv(np.einsum("ni,nj->ij", scaled, scaled), rcond=_BLIND, hermitian=True)
    return np.asarray(normal @ np.einsum("ni,nm->im", scaled, values) / size[:, None])


def observe(
    observer: Observer,
    sense: Array,
    drive: Array,
    gaps: Gaps | None,
    *,
    step: Array | None = None,
    every: int = 1,
    temperature: Array | None = None,
    acts: Sequence[tuple[int, Callable[[], None]]] = (),
) -> Estimates:
    """`Observer.run` over a record with gaps: after each the motion is as uncertain as the prediction of its drive.

    acts: by the number of a sample what is done to the observer before it, in ascending order.
    """
    if (gaps is None or not len(gaps)) and not acts:
        return observer.run(sense, drive, step=step, every=every, temperature=temperature)
    n = len(sense)
    parts, begin = [], 0
    for end, act in [*_breaks(observer, gaps, acts), (n, None)]:
        rows = slice(begin, end)
        if end > begin:
            parts.append(
                observer.run(
                    sense[rows],
                    drive[rows],
                    step=None if step is None else step[rows],
                    every=1 if every < n else end - begin,
                    temperature=None if temperature is None else temperature[rows],
                )
            )
        if act is not None:
            act()
        begin = end
    return _joined(parts, n, every)


def _breaks(
    observer: Observer, gaps: Gaps | None, acts: Sequence[tuple[int, Callable[[], None]]]
) -> list[tuple[int, Callable[[], None]]]:
    """Before which samples something is done to the observer, and what."""
    found = (
        []
        if gaps is None
        else [
            (end, partial(observer.unsettle, spread))
            for end, spread in zip((gaps.last + 1).tolist(), gaps.spread, strict=True)
        ]
    )
    return sorted([*acts, *found], key=lambda one: one[0])


def _joined(parts: list[Estimates], n: int, every: int) -> Estimates:
    """One after another, the state at every `every`-th of n samples; parts have it at all, or at their last."""
    series: dict[str, Any] = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(Estimates)
        if field.name != "names"
    }
    kept = slice(every - 1, None, every) if every < n else slice(-1, None) if every == n else slice(0)
    for name in ("state", "deviation"):
        series[name] = series[name][kept]
    series["index"] = np.arange(every - 1, n, every)
    return replace(parts[0], **series)
