"""How much each watched effect would explain, how sure that is, and which of them look the same on this record."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS
from estimator.trace.scan import Scan

_SET = THRESHOLDS.scan


@dataclass(frozen=True)
class Evidence:
    """What one effect would explain of a residual.

    gain: twice the gain of log-likelihood, χ² of `degrees` by chance alone; scatter: how much its coefficients differ
    between parts of the record, 1 when no more than noise makes them; coefficients, deviation: in SI.
    """

    name: str
    gain: float
    degrees: int
    scatter: float
    coefficients: Array
    deviation: Array

    @property
    def error(self) -> float:
        """Standard deviation of the gain, as far as it is the scan's own: what scatters by more than noise is not
        linear in the coefficients, and a gain of c²/σ² moves by 2c/σ for each σ that c is off.
        """
        return 2.0 * float(np.sqrt(max(self.scatter - 1.0, 0.0) * max(self.gain, 0.0)))

    @property
    def significance(self) -> float:
        """log10 of the probability that chance makes as much, the gain taken down by the scatter; large is sure."""
        gain = self.gain / max(self.scatter, 1.0)
        with np.errstate(divide="ignore"):  # beyond the least number there is, it is certain
            return float(-np.log(chdtrc(max(self.degrees, 1), gain)) / np.log(10.0))


def solve(normal: Array, score: Array) -> tuple[Array, int]:
    """Least-squares coefficients of N c = b, one b (k,) or several (k, m), and how many directions the record says
    something of.
    """
    values, vectors = np.linalg.eigh(normal)
    seen = values > _SET.blind * values[-1]
    shares = (vectors[:, seen].T @ score).T / values[seen]
    return np.asarray(vectors[:, seen] @ shares.T), int(seen.sum())


def evidence(scan: Scan) -> dict[str, Evidence]:
    """Evidence of every watched effect by itself, best first; of one whose equations are no numbers there is none."""
    total, score = scan.normal.sum(axis=0), scan.score.sum(axis=0)
    found = []
    for name, columns in scan.columns.items():
        if not _is_told(scan, columns):
            continue
        normal, b = total[columns, columns], score[columns]
        coefficients, degrees = solve(normal, b)  # what the innovations lose by it, so with the sign turned
        own = scan.normal[:, columns, columns]
        left = scan.score[:, columns] - own @ coefficients
        misfit, freedom = 0.0, 0
        for part_normal, part_left in zip(own, left, strict=True):
            shift, rank = solve(part_normal, part_left)
            misfit += float(part_left @ shift)
            freedom += rank
        information = np.maximum(np.diag(np.linalg.pinv(normal, rcond=_SET.blind)), 0.0)
        found.append(
            Evidence(
                name,
                float(b @ coefficients),
                degrees,
                misfit / max(freedom - degrees, 1),
                -coefficients * scan.plausible[columns],
                np.sqrt(information) * scan.plausible[columns],
            )
        )
    return {item.name: item for item in sorted(found, key=lambda item: -item.gain)}


def _is_told(scan: Scan, columns: slice) -> bool:
    """Whether the scan followed an effect: where an observer diverges, what it is watched by may overflow."""
    return bool(np.isfinite(scan.normal[:, columns, columns]).all() and np.isfinite(scan.score[:, columns]).all())


def likeness(scan: Scan, name: str, coefficients: Array | None = None) -> dict[str, float]:
    """How well each other watched effect can imitate `name`: the correlation of its signature, with the coefficients
    given (SI; else those found), with what the other could make of it, everything the observer estimates projected out.
    """
    return {other: one.likeness for other, one in imitations(scan, name, coefficients).items()}


@dataclass(frozen=True)
class Imitation:
    """What another effect can make of a signature.

    size: of the signature, the gain of twice the log-likelihood that the effect would be; form (k, k): of that, what
    the other cannot imitate, as a quadratic form of the effect's coefficients, SI; left: its value, by which the two
    differ in twice the log-likelihood.
    """

    size: float
    form: Array
    left: float

    @property
    def likeness(self) -> float:
        """Correlation of the signature and its imitation."""
        return float(np.sqrt(np.clip(1.0 - self.left / self.size, 0.0, 1.0)))


def imitations(scan: Scan, name: str, coefficients: Array | None = None, *, begin: int = 0) -> dict[str, Imitation]:
    """By each other watched effect, of `name` with these coefficients (SI; else those found), everything the observer
    estimates projected out; of the parts of the record from `begin` on.
    """
    total, score = scan.normal[begin:].sum(axis=0), scan.score[begin:].sum(axis=0)
    columns = scan.columns[name]
    own = total[columns, columns]
    c = solve(own, score[columns])[0] if coefficients is None else -coefficients / scan.plausible[columns]
    size = float(c @ own @ c)
    found = {}
    for other, others in scan.columns.items():
        if other == name or not size > 0.0 or not _is_told(scan, others):
            continue
        cross = total[others, columns]
        form = own - cross.T @ solve(total[others, others], cross)[0]
        plausible = scan.plausible[columns]
        found[other] = Imitation(size, form / np.outer(plausible, plausible), float(c @ form @ c))
    return found
