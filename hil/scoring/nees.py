"""Does the observer know how wrong it is?  The normalised estimation error squared of a run, beside its χ² band."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from hil.numbers import significant
from hil.records.estimates import Covariance, Estimates
from hil.records.result import Nees
from hil.records.truth import Truth

Floats = npt.NDArray[np.float64]

NAMED = "NEES per entry is"
"""How its remark begins."""


def nees(covariance: Covariance, estimates: Estimates, truth: Truth, settle_s: float) -> Nees | None:
    """Mean of eᵀ C⁻¹ e per entry from `settle_s` on, over the instants that all three records share.

    Left out are entries without a known truth (coefficients of effects) and those declared as known exactly (no
    variance).  None where nothing is left, or where a matrix is not positive definite and so no covariance.
    """
    names = _scored(covariance, truth)
    squares, ticks = [], []
    for here, part, true_part in _stretches(covariance, estimates, truth):
        row, estimated, true = _shared(here, part, true_part, settle_s)
        if not names or not row.size:
            continue
        errors = [part[name][estimated] - _true(name, true_part, true) for name in names]
        kept = [here.entries.index(name) for name in names]
        try:
            with np.errstate(all="ignore"):  # of an observer that diverged: told below
                square = normalised_squares(np.stack(errors, axis=1), here.matrices[row][:, kept][:, :, kept])
        except np.linalg.LinAlgError:
            return None
        squares.append(square)
        ticks.append(here.tick[row])
    squared = np.concatenate(squares) if squares else np.empty(0)
    if not squared.size or not np.isfinite(squared).all():
        return None
    window_s = (int(ticks[-1][-1]) - int(ticks[0][0])) / estimates.tick_rate_Hz
    independent = independent_instants(estimates, squared.size, window_s)
    return Nees(
        mean=float(squared.mean()) / len(names),
        entries=len(names),
        instants=squared.size,
        independent=independent,
        band=band(len(names) * independent),
    )


def outside(found: Nees) -> list[str]:
    """A remark where the mean lies outside its band."""
    low, high = found.band
    if low <= found.mean <= high:
        return []
    size = "large" if found.mean < low else "small"
    return [
        f"{NAMED} {significant(found.mean)}, outside its 95 % band {low:.2f} to {high:.2f}: the standard deviations of "
        f"the states are too {size}"
    ]


def _stretches(
    covariance: Covariance, estimates: Estimates, truth: Truth
) -> Iterator[tuple[Covariance, Estimates, Truth]]:
    """The three in parts of the same stretch of ticks, none of them large: a truth has a row for every sample."""
    for piece in covariance.pieces():
        for part in truth.between(int(piece.tick[0]), int(piece.tick[-1])).pieces():
            first, last = int(part.tick[0]), int(part.tick[-1])
            yield piece.between(first, last), estimates.between(first, last), part


def normalised_squares(error: Floats, covariance: Floats) -> Floats:
    """eᵀ C⁻¹ e (m,) of errors (m, n) with covariances (m, n, n); LinAlgError where one is not positive definite."""
    deviation = np.sqrt(np.einsum("mii->mi", covariance))
    normalised = covariance / (deviation[:, :, None] * deviation[:, None, :])  # units are decades apart
    white = np.linalg.solve(np.linalg.cholesky(normalised), (error / deviation)[:, :, None])[:, :, 0]
    return np.asarray(np.sum(white**2, axis=1))


def independent_instants(estimates: Estimates, instants: int, window_s: float) -> float:
    """How many independent instants those of a window are worth, at least 1.

    With a memory T the errors of the constants are alike for about T: instants t apart share e^(−t/T) of their
    information, and the squares decorrelate with e^(−2t/T), whose two sides add up to T.  Without fading what is
    constant is never forgotten, and all instants of a run tell of one draw.  The motion decorrelates faster: the
    number is a lower bound, and the band by it rather too wide.
    """
    settings = estimates.header.get("settings", {})
    if settings.get("gain", "ekf") == "ekf" or not settings.get("memory"):
        return 1.0
    return float(min(max(window_s / float(settings["memory"]), 1.0), instants))


def band(degrees: float) -> tuple[float, float]:
    """Where 95 % of χ² of so many degrees of freedom lie, per degree."""
    from scipy.special import gammaincinv  # loads slowly: only where there is something to judge

    low, high = 2.0 * gammaincinv(0.5 * degrees, (0.025, 0.975)) / degrees
    return float(low), float(high)


def _shared(
    covariance: Covariance, estimates: Estimates, truth: Truth, settle_s: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Rows of covariance, estimates and truth (m,) each, at the ticks that all have from `settle_s` on."""
    ours = np.flatnonzero(covariance.tick >= settle_s * estimates.tick_rate_Hz)
    ours = ours[np.isin(covariance.tick[ours], estimates.tick)]
    found, true = truth.at(covariance.tick[ours])
    row = ours[found]
    return row, np.searchsorted(estimates.tick, covariance.tick[row]), true


def _scored(covariance: Covariance, truth: Truth) -> list[str]:
    """Entries that have a truth and a variance."""
    known = [name for name in covariance.entries if name in truth.constants or name in truth.columns]
    return [name for name in known if len(covariance) and np.all(covariance.columns[f"{name}*{name}"] > 0.0)]


def _true(name: str, truth: Truth, rows: npt.NDArray[np.intp]) -> Floats:
    """The truth of an entry at `rows` of the truth."""
    return np.full(rows.size, truth.constants[name]) if name in truth.constants else truth[name][rows]
