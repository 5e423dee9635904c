"""Which keys a figure depends on: its variance over the campaign, divided among keys, pairs of keys, and the rest.

The figure (its logarithm, where it is positive throughout) is fitted by polynomials of each key and products of two,
orthonormal over the points that were run.  The square of a coefficient is then its share of the variance: the
first-order and second-order indices of Sobol (Math. Comput. Simul. 55, 2001) by polynomial chaos (Sudret, Reliab. Eng.
Syst. Saf. 93, 2008); over a full grid with as many degrees as levels it is the analysis of variance.  What noise alone
gives a squared coefficient is taken off; intervals are by propagation of the coefficients' own deviations.  The fit is
judged by what it predicts of each run when that is left out.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.numbers import SD_95
from hil.sweeping.campaign import Vary
from hil.sweeping.plan import Plan

if TYPE_CHECKING:
    import pyarrow

Floats = npt.NDArray[np.float64]

_DEGREE = 3
_LEVELS = 6
"""Of listed values: up to so many each is on its own, more are taken as steps of a scale."""
_ROWS_PER_TERM = 3


class Share(NamedTuple):
    """Share of the variance that one key, or two together beyond what each does alone, accounts for; 95 % interval.

    first, last: mean that the fit gives the figure (geometric, where it is taken by its logarithm) over the lowest and
    the highest third of the key's range, the others as they come; None of pairs.
    """

    keys: tuple[str, ...]
    share: float
    interval: tuple[float, float]
    first: float | None = None
    last: float | None = None

    @property
    def clear(self) -> bool:
        """Whether it is more than nothing."""
        return self.interval[0] > 0.0


class Dependence(NamedTuple):
    """The decomposition: of `figure` over `rows` runs; shares of keys and of pairs, largest first.

    explained: of the variance by the fit.  predicted: of the variance of runs left out, 0 or less for a fit that is
    worth nothing.  between_seeds: share of the variance that runs of one point have among themselves, None where there
    is one of each.
    """

    figure: str
    logarithmic: bool
    rows: int
    left_out: int
    keys: tuple[Share, ...]
    pairs: tuple[Share, ...]
    explained: float
    predicted: float
    between_seeds: float | None


def dependence(plan: Plan, table: "pyarrow.Table", figure: str) -> Dependence | None:
    """Of a column of the results; None where nothing is varied, too few runs have the figure, or it is always alike."""
    values = np.array(table[figure].to_numpy(zero_copy_only=False), dtype=float)
    point = np.array(table["point"].to_numpy(), dtype=np.intp)
    known = np.isfinite(values)
    values, point = values[known], point[known]
    if len(values) < 2 * _ROWS_PER_TERM:
        return None
    shares = plan.shares[point]
    moved = np.flatnonzero(np.ptp(shares, axis=0))  # a key that stayed where it was explains nothing
    if not moved.size:
        return None
    vary, shares = [plan.campaign.vary[place] for place in moved], shares[:, moved]
    logarithmic = bool(np.all(values > 0.0))
    y = np.log10(values) if logarithmic else values
    variance = float(np.var(y))
    if variance <= 1e-24 * (1.0 + float(np.mean(y)) ** 2):
        return None
    groups, a = _terms(vary, shares, len(y))
    solved = _fit(a, y)
    if solved is None:
        return None
    coefficients, spread, residual, leverage = solved
    # Not the variance of what was drawn: in a drawn design keys are correlated by chance, and share what is of neither.
    freedom = len(y) - a.shape[1]
    parts = float(np.sum(coefficients[1:] ** 2 - spread[1:] ** 2)) + float(residual @ residual) / freedom
    found = []
    for keys, columns in groups:
        share, half = _share(coefficients[columns], spread[columns], parts)
        ends: tuple[float | None, float | None] = (None, None)
        if len(keys) == 1:
            alone = coefficients[0] + a[:, columns] @ coefficients[columns]
            ends = _ends(alone, shares[:, _place(vary, keys[0])], logarithmic)
        found.append(Share(keys, share, (max(share - half, 0.0), min(share + half, 1.0)), *ends))
    found.sort(key=lambda one: -one.share)
    loo = residual / (1.0 - leverage)
    return Dependence(
        figure=figure,
        logarithmic=logarithmic,
        rows=len(y),
        left_out=int(np.count_nonzero(~known)),
        keys=tuple(one for one in found if len(one.keys) == 1),
        pairs=tuple(one for one in found if len(one.keys) == 2),
        explained=1.0 - float(np.mean(residual**2)) / variance,
        predicted=1.0 - float(np.mean(loo**2)) / variance,
        between_seeds=_between_seeds(y, point, variance),
    )


def _terms(
    vary: Sequence[Vary], shares: Floats, rows: int
) -> tuple[list[tuple[tuple[str, ...], npt.NDArray[np.intp]]], Floats]:
    """Columns (rows, terms) with the constant first, and which belong to which key or pair; as many as rows bear."""
    for degree, pairs in ((_DEGREE, True), (2, True), (1, True), (2, False), (1, False)):
        bases = [_basis(one, shares[:, place], degree) for place, one in enumerate(vary)]
        blocks: list[tuple[tuple[str, ...], Floats]] = [
            ((one.column,), basis) for one, basis in zip(vary, bases, strict=True)
        ]
        if pairs:
            for (one, a), (other, b) in combinations(zip(vary, bases, strict=True), 2):
                a, b = (basis if _few(v) else basis[:, :1] for v, basis in ((one, a), (other, b)))
                product = (a[:, :, None] * b[:, None, :]).reshape(len(a), -1)
                blocks.append(((one.column, other.column), product))
        terms = 1 + sum(block.shape[1] for _, block in blocks)
        if terms * _ROWS_PER_TERM <= rows or (degree, pairs) == (1, False):
            break
    groups, start = [], 1
    for keys, block in blocks:
        groups.append((keys, np.arange(start, start + block.shape[1])))
        start += block.shape[1]
    return groups, np.concatenate([np.ones((len(shares), 1)), *(block for _, block in blocks)], axis=1)


def _few(one: Vary) -> bool:
    levels = len(one.values) if one.values is not None else one.levels
    return levels is not None and levels <= _LEVELS


def _basis(one: Vary, share: Floats, degree: int) -> Floats:
    """Polynomials of a key's share, without the constant, orthonormal over the rows: mean squares of 1."""
    distinct = len(np.unique(share))
    degree = min(distinct - 1, distinct - 1 if _few(one) else degree)
    powers = np.stack([(2.0 * share - 1.0) ** k for k in range(degree + 1)], axis=1)
    q, _ = np.linalg.qr(powers)
    return np.asarray(q[:, 1:] * np.sqrt(len(share)))


def _fit(a: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats] | None:
    """Coefficients, their deviations, residuals and leverages of least squares; None where it has no freedom."""
    rows, terms = a.shape
    if rows <= terms:
        return None
    q, r = np.linalg.qr(a)
    if np.any(np.abs(np.diag(r)) < 1e-10 * np.sqrt(rows)):
        return None
    inverse = np.linalg.inv(r)
    coefficients = inverse @ (q.T @ y)
    residual = y - a @ coefficients
    sigma = float(residual @ residual) / (rows - terms)
    leverage = np.minimum(np.sum(q**2, axis=1), 1.0 - 1e-9)
    return coefficients, np.sqrt(sigma * np.sum(inverse**2, axis=1)), residual, leverage


def _share(coefficient: Floats, deviation: Floats, variance: float) -> tuple[float, float]:
    """Σ(c² − s²) over the variance, and half of its 95 % interval: Var(c²) = 4 c² s² + 2 s⁴."""
    share = float(np.sum(coefficient**2 - deviation**2)) / variance
    spread = float(np.sqrt(np.sum(4.0 * coefficient**2 * deviation**2 + 2.0 * deviation**4))) / variance
    return max(share, 0.0), SD_95 * spread


def _ends(y: Floats, share: Floats, logarithmic: bool) -> tuple[float | None, float | None]:
    means = []
    for part in (share <= np.quantile(share, 1 / 3), share >= np.quantile(share, 2 / 3)):
        mean = float(np.mean(y[part]))
        means.append(10.0**mean if logarithmic else mean)
    return means[0], means[1]


def _place(vary: Sequence[Vary], column: str) -> int:
    return next(place for place, one in enumerate(vary) if one.column == column)


def _between_seeds(y: Floats, point: npt.NDArray[np.intp], variance: float) -> float | None:
    _, index, counts = np.unique(point, return_inverse=True, return_counts=True)
    freedom = len(y) - len(counts)
    if freedom < 1:
        return None
    means = np.bincount(index, weights=y) / counts
    return min(float(np.sum((y - means[index]) ** 2)) / freedom / variance, 1.0)
