"""Whether what was named has the coefficients of a constant: the same in every part of the record.

A model of the right form leaves innovations that say nothing more of its coefficients, wherever one looks.  One of
another form has found their average, and each part of the record, with another amplitude, drive or rate, asks for
others.  With n parts of N and b, the normal equations of the coefficients about those found, the sum of b N⁻¹ b over
the parts, less that of all parts together, is χ² by chance, and what the likelihood would gain were each part to have
its own (score test of constant parameters; Nyblom, Journal of the American Statistical Association 84(405), 1989).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from estimator.thresholds import THRESHOLDS
from estimator.trace.candidates import kind
from estimator.trace.evidence import solve
from estimator.trace.fitting import Fitted, parameters_of
from estimator.trace.look import scanned_with
from estimator.trace.problem import Problem
from estimator.trace.scan import Scan, scan

_LABEL = "again"


@dataclass(frozen=True)
class Constancy:
    """What coefficients would gain, in twice the log-likelihood, were they others in each part of the record; degrees:
    what chance gives.
    """

    gain: float
    degrees: int

    @property
    def chance(self) -> float:
        """Probability that chance makes as much."""
        return float(chi2.sf(self.gain, self.degrees)) if self.degrees > 0 else 1.0

    @property
    def excess(self) -> float:
        """What is gained beyond chance."""
        return max(self.gain - self.degrees, 0.0)


def constancies(problem: Problem, model: Fitted, names: Iterable[str]) -> Mapping[str, Constancy]:
    """Of effects that `model` carries, fitted to the record of `problem`: by one scan that watches them once more.

    What is carried is held meanwhile: an observer that still learns a coefficient has taken up by the later parts what
    they would say of it, and what is left there is of second order.
    """
    part = problem.part(slice(0, THRESHOLDS.choice.confirmed))
    again = {f"{kind(name)}:{_LABEL}{n}": name for n, name in enumerate(names)}
    if not again or not np.isfinite(model.likelihood):
        return {}
    watched = {label: parameters_of(model, name) for label, name in again.items()}
    settings = scanned_with(model, part.device, part.settings)
    seen = scan(part.under(settings), watched, model.observer, held=True)
    return {again[label]: constancy(seen, label) for label in again}


def constancy(seen: Scan, name: str) -> Constancy:
    """Of one watched effect, by the parts of a scan in which its equations are numbers; the others can say nothing."""
    columns = seen.columns[name]
    normal, score = seen.normal[:, columns, columns], seen.score[:, columns]
    told = np.isfinite(normal).all(axis=(1, 2)) & np.isfinite(score).all(axis=1)
    if not told.any():
        return Constancy(0.0, 0)
    normal, score = normal[told], score[told]
    common, together = solve(normal.sum(axis=0), score.sum(axis=0))
    gain, degrees = 0.0, -together
    for own, b in zip(normal, score - normal @ common, strict=True):
        shift, seen_there = solve(own, b)
        gain, degrees = gain + float(b @ shift), degrees + seen_there
    return Constancy(gain, degrees)
