"""A filter's pass over a record with score and information of its likelihood (estimator/core/likelihood.h)."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.core.arguments import Arguments
from estimator.core.following import BLOCK, Observing, Portion, Signatures, scan_of
from estimator.core.layout import Floats, Ints
from estimator.core.library import LIBRARY

_PANEL = 64 + 2
"""Rows that are multiplied out together, and those of the sample that fills them."""

_PASS = Arguments("likelihood.h", "Likelihood")


@dataclass(frozen=True)
class Samples:
    """A record in parts, as a filter takes it: bounds (parts + 1,) of the parts; skip: samples of the start that do not
    count.
    """

    portion: Portion
    bounds: Ints
    skip: int


class Pass:
    """What a filter makes of a record, its sensitivities followed: of `known` constants (indices among all) that it
    does not estimate, of `watched` coefficients that it lacks, and of models that are shifted in one parameter, by
    their own innovations `others` (m, axes · n), whitened, over the shifts (m,).

    innovation, variance (n, axes), scaled; white (axes · n,) innovations, whitened, 0 where none counts; by part: gram
    (parts, k + 1 + m, k + 1 + m) of their rows [sensitivities, innovation, derivatives by the shifts], the sum of the
    logarithms of their deviations, how many there are.
    """

    def __init__(
        self, samples: Samples, rows: int, known: Ints, watched: int, others: Sequence[Floats], shifts: Sequence[float]
    ) -> None:
        self.samples, self.known = samples, known
        n, axes = samples.portion.z.shape
        parts, k = len(samples.bounds) - 1, len(known) + watched
        self.width = -(-(k + 2 + len(others)) // BLOCK) * BLOCK
        self.used = k + 1 + len(others)
        self.delta = np.zeros((rows, k))
        self.innovation, self.variance = np.zeros((n, axes)), np.zeros((n, axes))
        self.white = np.zeros(axes * n)
        self.logs, self.counted = np.zeros(parts), np.zeros(parts, np.int64)
        self._gram = np.zeros((parts, self.width, self.width))
        self._panel = np.zeros((_PANEL, self.width))
        self._others, self._shifts = np.array(others).reshape(len(others), axes * n), np.array(shifts)

    @property
    def gram(self) -> Floats:
        """Its products, both triangles."""
        upper = np.triu(self._gram[:, : self.used, : self.used])
        return np.asarray(upper + np.swapaxes(np.triu(upper, 1), 1, 2))

    def advance(self, observer: Observing, begin: int, end: int) -> None:
        """Over these samples; the next call goes on behind them."""
        samples = self.samples
        scan = scan_of(observer, samples.portion, Signatures(self.delta, known=self.known), self.width)
        LIBRARY.gyro_likelihood_pass(
            ctypes.c_void_p(observer.core), scan,
            _PASS(
                begin=begin, end=end, skip=samples.skip, shifted=len(self._shifts), parts=len(self.logs),
                bounds=samples.bounds, others=self._others, shifts=self._shifts, innovation=self.innovation,
                variance=self.variance, white=self.white, gram=self._gram, logs=self.logs, counted=self.counted,
                panel=self._panel,
            ),
        )  # fmt: skip
