"""What a record says of the coefficients of effects that are not carried, and what each does to the angle.

A scan gives the normal equations of all coefficients at once, with everything that the observer estimates projected
out: the information matrix N and the score b of a linear model with coefficients c.  With a prior covariance P0 of some
of them (what a calibration declares) c is normal with covariance C = (N + P0⁻¹)⁻¹ and mean −C b, and what stays
uncertain of the angle is gᵀ C g, with g what a unit of each coefficient moves the reported angle by.  Look-alikes come
out right: where N cannot tell two of them apart, C holds both as large as their priors, and their correlation says that
one goes with the other.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.effects.labels import kind
from estimator.errors import ModelError
from estimator.scaling import Array

SIZES = (1.0, 0.1, 0.01, 0.001)
"""Of the plausible one, all as probable beforehand: an effect that nobody thought of has no usual size."""


@dataclass(frozen=True)
class ScannedCoefficient:
    """One coefficient of an effect that was watched.

    effect: its name, with a label where it was watched with several parameters; plausible: its largest likely size, SI.
    """

    effect: str
    symbol: str
    unit: str
    plausible: float


@dataclass(frozen=True)
class Posterior:
    """Coefficients c after the record: normal with this mean (k,) and covariance (k, k), SI, by `symbols`.

    sensitivity (m, k) rad per SI unit: what each moves the reported angle by, at the instants of the `Information`;
    at its first instant, the start of the scored window, it is zero.  log_evidence: how much better than without any
    coefficient these priors predict the record.
    """

    symbols: tuple[str, ...]
    units: tuple[str, ...]
    mean: Array
    covariance: Array
    sensitivity: Array
    log_evidence: float = 0.0

    def part(self, places: Sequence[int]) -> "Posterior":
        """The same of these coefficients, the others being as likely as they are."""
        return Posterior(
            tuple(self.symbols[k] for k in places), tuple(self.units[k] for k in places), self.mean[places],
            self.covariance[np.ix_(places, places)], self.sensitivity[:, places], self.log_evidence,
        )  # fmt: skip

    @property
    def deviation(self) -> Array:
        """Standard deviation (k,) of each coefficient."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))

    @property
    def angle_deviation(self) -> Array:
        """Standard uncertainty (m,) of the angle from all of them together, rad."""
        spread = np.einsum("mi,ij,mj->m", self.sensitivity, self.covariance, self.sensitivity)
        return np.asarray(np.sqrt(np.maximum(spread, 0.0)))

    @property
    def angle_uncertainty(self) -> Array:
        """Root mean square (m,) of what the angle is expected to be off by, the coefficients not being carried, rad."""
        return np.asarray(np.hypot(self.angle_deviation, self.sensitivity @ self.mean))


@dataclass(frozen=True)
class Information:
    """Normal equations of the watched coefficients, and the angle's sensitivity to them.

    normal (k, k), score (k,): N and b over the whole record, scaled to the plausible sizes; time (m,) s from the start
    of the run, the first instant being the start of what was scored; sensitivity (m, k): rad per SI unit, zero at the
    first instant; widening: by how much deviations are larger than N says, as the innovations are; found (m,) rad: how
    far effects that are there turned the angle, too little to matter and not among the coefficients, None without any.
    """

    coefficients: tuple[ScannedCoefficient, ...]
    normal: Array
    score: Array
    time: Array
    sensitivity: Array
    widening: float = 1.0
    found: Array | None = None

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects watched, in order."""
        return tuple(dict.fromkeys(c.effect for c in self.coefficients))

    def columns(self, names: Sequence[str]) -> list[int]:
        """Places of the coefficients of these symbols, or of these effects.

        Raises ModelError for a name that was not watched.
        """
        places: list[int] = []
        for name in names:
            found = [k for k, c in enumerate(self.coefficients) if name in (c.symbol, c.effect)]
            if not found:
                raise ModelError(f"no coefficient {name!r} was watched")
            places += found
        return places

    def watches(self, symbol: str) -> bool:
        """Whether a coefficient of that symbol was watched: an open loop shows nothing of the drive."""
        return any(c.symbol == symbol for c in self.coefficients)

    def posterior(
        self, prior_sd: Mapping[str, float], with_effect: str | None = None, *, size: float = 1.0
    ) -> Posterior:
        """The coefficients of `prior_sd` (SI, standard deviations by symbol; 0 is known exactly, inf is no knowledge
        but the plausible size) after the record, all others being absent but those of `with_effect`, of which so much
        of the plausible size is the standard deviation before it.

        Symbols that were not watched are left as their prior says, with no part in the angle (`watches` tells).
        """
        declared = [symbol for symbol in prior_sd if self.watches(symbol)]
        places = [self.columns([symbol])[0] for symbol in declared]
        sd = [prior_sd[symbol] for symbol in declared]
        if with_effect is not None:
            more = [k for k in self.columns([with_effect]) if k not in places]
            places += more
            sd += [size * self.coefficients[k].plausible for k in more]
        chosen = [self.coefficients[k] for k in places]
        scale = np.array([c.plausible for c in chosen])
        relative = np.minimum(np.array(sd, dtype=float) / scale, np.where(np.isinf(sd), 1.0, np.inf))
        # (N + P0⁻¹)⁻¹ = R (I + R N R)⁻¹ R with R = P0^½: a coefficient known exactly needs no infinity.
        root = np.diag(relative)
        within = np.eye(len(places)) + root @ self.normal[np.ix_(places, places)] @ root / self.widening**2
        covariance = root @ np.linalg.solve(within, root) if places else np.zeros((0, 0))
        score = self.score[places] / self.widening**2
        mean = -covariance @ score
        return Posterior(
            tuple(c.symbol for c in chosen),
            tuple(c.unit for c in chosen),
            mean * scale,
            covariance * np.outer(scale, scale),
            self.sensitivity[:, places],
            0.5 * float(score @ covariance @ score - np.linalg.slogdet(within)[1]) if places else 0.0,
        )

    def beyond(self, prior_sd: Mapping[str, float]) -> tuple[str, Array]:
        """What the record leaves open beside the calibration: the effect without prior that contributes most ("" where
        there is none), and by how much (m,) rad, rms, the angle may be off for all of them, with what was found and is
        harmless.

        One effect at a time may be there that nobody declared, or none, each as likely before the record as the other,
        and of any size up to the plausible one.  The record then says how probable each is, and
        how large: what it shows nothing of is as unlikely as it was, what it excludes is less so.
        """
        declared = self.posterior(prior_sd)
        known = declared.angle_uncertainty**2
        accounts: dict[tuple[str, float], tuple[float, Array]] = {}
        for effect in self.effects:
            if all(self.coefficients[k].symbol in prior_sd for k in self.columns([effect])):
                continue
            for size in SIZES:
                beside = self.posterior(prior_sd, effect, size=size)
                more = np.maximum(beside.angle_uncertainty**2 - known, 0.0)
                accounts[effect, size] = beside.log_evidence - declared.log_evidence, more
        found = np.zeros(len(self.time)) if self.found is None else self.found
        if not accounts:
            return "", found
        chances = self._chances({account: evidence for account, (evidence, _) in accounts.items()})
        by_effect: dict[str, Array] = {}
        for (effect, size), (_, more) in accounts.items():
            by_effect[effect] = by_effect.get(effect, 0.0) + chances[effect, size] * more
        most = max(by_effect, key=lambda effect: float(np.max(by_effect[effect])))
        return most, np.asarray(np.sqrt(sum(by_effect.values()) + found**2))

    def _chances(self, evidence: Mapping[tuple[str, float], float]) -> dict[tuple[str, float], float]:
        """Probability after the record of each (effect, size), of which one or none is there; `evidence` is the log of
        how much better each predicts the record than none.  All kinds are as probable beforehand, with however many
        parameters each was tested.
        """
        kinds = Counter(kind(effect) for effect, _ in evidence)
        logs = {
            account: gain + math.log(1.0 / (len(kinds) * kinds[kind(account[0])])) if math.isfinite(gain) else -math.inf
            for account, gain in evidence.items()
        }
        largest = max(0.0, *logs.values())
        weights = {account: math.exp(log - largest) for account, log in logs.items()}
        total = math.exp(-largest) + sum(weights.values())
        return {account: weight / total for account, weight in weights.items()}
