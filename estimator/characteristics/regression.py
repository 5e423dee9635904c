"""Least squares on a record in time order, whose errors need not be independent.

The covariance is that of independent errors, wider for each coefficient by how much more the shares of long stretches
in it scatter than independent errors would make them: so it follows the density of the errors at what the column does,
a drift at the mean, a line at a harmonic. The degrees of freedom fall by the largest of these factors.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.chance import TWO_SIDED

Floats = npt.NDArray[np.float64]

_STRETCHES = (100, 20)
_SURELY = 20.0
"""Standard deviations beyond which a length is normal."""
_INFLATED = 10.0
"""Variance inflation above which a coefficient is not told apart from those before it: Kutner, Nachtsheim, Neter & Li,
Applied Linear Statistical Models, 5th ed., section 10.5."""


class Estimate(NamedTuple):
    """A value with its 95 % interval; `said` is what limits it, "" where nothing does."""

    value: float
    low: float
    high: float
    said: str = ""

    @classmethod
    def about(cls, value: float, half: float, said: str = "") -> "Estimate":
        """With an interval of that half width."""
        return cls(value, value - half, value + half, said)

    @classmethod
    def of_two(cls, first: float, second: float, sd: float, freedom: float) -> "Estimate":
        """The length of two coefficients, each of that standard deviation, with the lengths that the one found denies
        at neither end: of none the length is above 0 too, and Rice-distributed. One found below the median of none
        denies no more than that would. Few degrees of freedom widen the deviation as they do Student's.
        """
        size, wide = math.hypot(first, second), sd * _quantile(freedom) / TWO_SIDED
        if not wide > size / _SURELY:
            return cls(size, size - TWO_SIDED * wide, size + TWO_SIDED * wide)
        from scipy.optimize import brentq
        from scipy.stats import ncx2

        def below(seen: float, true: float) -> float:
            return float(ncx2.cdf((seen / wide) ** 2, 2, (true / wide) ** 2))

        denying, near = max(size, wide * math.sqrt(2.0 * math.log(2.0))), 1e-6 * wide
        high = brentq(lambda true: below(denying, true) - 0.025, 0.0, denying + 10.0 * wide, xtol=near)
        low = 0.0
        if below(size, 0.0) > 0.975:
            low = brentq(lambda true: below(size, true) - 0.975, 0.0, size, xtol=near)
        return cls(size, float(low), float(high))

    @property
    def size(self) -> "Estimate":
        """Of the magnitude."""
        if self.value < 0.0:
            return Estimate(-self.value, -self.high, -self.low, self.said).size
        return Estimate(self.value, max(self.low, 0.0), self.high, self.said)


@dataclass(frozen=True)
class Fitted:
    """Coefficients by name, their covariance (k, k) in that order, the residual (n,), degrees of freedom.

    confounded: names of columns that the record does not tell apart from those before them.
    """

    names: tuple[str, ...]
    values: Floats
    covariance: Floats
    residual: Floats
    freedom: float
    confounded: tuple[str, ...] = ()

    @property
    def factor(self) -> float:
        """Half width of the 95 % interval over the standard deviation."""
        return _quantile(self.freedom)

    def of(self, name: str) -> float:
        """A coefficient; 0 where the record could not tell it."""
        return float(self.values[self.names.index(name)]) if name in self.names else 0.0

    def sd(self, *names: str) -> float:
        """Standard deviation of the root of the mean of squares of some coefficients, or of one."""
        at = [self.names.index(name) for name in names]
        return float(np.sqrt(np.mean(np.diag(self.covariance)[at])))

    def estimate(self, name: str, scale: float = 1.0) -> Estimate | None:
        """A coefficient times `scale`; None where the record could not tell it."""
        if name not in self.names:
            return None
        return Estimate.about(scale * self.of(name), abs(scale) * self.factor * self.sd(name))


def _quantile(freedom: float) -> float:
    from scipy.stats import t

    return float(t.ppf(0.975, freedom))


def least_values(columns: int) -> int:
    """How many values a fit of so many columns needs."""
    return 2 * columns + 2


def fitted(columns: Mapping[str, Floats], values: Floats) -> Fitted | None:
    """`values` (n,) as a sum of `columns` (n,), those in front first: one that is not told apart from them is left out.

    None where there are fewer than `least_values`.
    """
    kept: dict[str, Floats] = {}
    basis = np.zeros((values.size, 0))
    for name, column in columns.items():
        size = float(np.linalg.norm(column))
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        length = float(np.linalg.norm(rest))
        if size > 0.0 and size**2 < _INFLATED * length**2:
            kept[name] = column
            basis = np.column_stack([basis, rest / length])
    if values.size < least_values(len(kept)) or not kept:
        return None
    matrix = np.column_stack(list(kept.values()))
    scale = np.linalg.norm(matrix, axis=0)
    found, _, _, _ = np.linalg.lstsq(matrix / scale, values, rcond=None)
    residual = values - (matrix / scale) @ found
    free = values.size - len(kept)
    inverse = np.linalg.pinv((matrix / scale).T @ (matrix / scale))
    each = np.array([wider(residual, row) for row in inverse @ (matrix / scale).T])
    shared = np.sqrt(np.outer(each, each))
    covariance = shared * float(residual @ residual) / free * inverse / np.outer(scale, scale)
    correlated = float(each.max())
    confounded = tuple(name for name in columns if name not in kept)
    return Fitted(tuple(kept), found / scale, covariance, residual, max(free / correlated, 2.0), confounded)


def wider(residual: Floats, weight: Floats | None = None) -> float:
    """Variance of a weighted sum of the residual (n,) by the sums over stretches, over what independent errors would
    make it, 1 at least; `weight` (n,), of a mean without one.
    """
    shares = residual if weight is None else residual * weight
    square = float(np.mean(residual**2)) * (1.0 if weight is None else float(np.mean(weight**2)))
    found = [1.0]
    for stretches in _STRETCHES:
        length = residual.size // stretches
        if length >= 2 and square > 0.0:
            means = shares[: length * stretches].reshape(stretches, length).mean(1)
            found.append(float(np.mean(means**2)) * length / square)
    return max(found)
