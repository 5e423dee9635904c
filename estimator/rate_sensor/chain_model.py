"""Models of a rate sensor: the chain from rate to volts with the effects it has, fitted to the output."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.rate_sensor.declaration import Effect, Stage
from estimator.rate_sensor.model import Chain, Rows, SensorFit, fit, straight_line
from estimator.residual.effective import effective_samples
from estimator.trace.criterion import extended, schwarz
from estimator.trace.engine import Estimate, Score, Trial

_ALTERNATIVES = ({"saturation", "soft_saturation"}, {"lag", "second_order"})


@dataclass(frozen=True)
class ChainModel:
    """`estimator.trace.engine.Model` of chains, fitted to `rows` and judged by the others, whose noise floor is `floor`
    V; line: the base model of the data sheet, with which the first effect is compared there.
    """

    candidates: tuple[Effect, ...]
    rows: Rows
    floor: float
    line: SensorFit

    def promise(self, current: SensorFit, barred: Collection[str]) -> tuple[str, ...]:
        """Who may still be added: a fit is so cheap that nothing is said beforehand of what it explains."""
        names = (effect.name for effect in self.candidates if _open(effect, current.chain))
        return tuple(name for name in names if name not in barred)

    def hopeful(
        self, look: tuple[str, ...], tried: Mapping[str, Trial[SensorFit]], refused: Collection[str], number: int
    ) -> Sequence[str]:
        """All of them."""
        return look

    def fit(
        self,
        current: SensorFit,
        look: tuple[str, ...],
        names: Sequence[str],
        tried: Mapping[str, Trial[SensorFit]],
    ) -> Mapping[str, SensorFit]:
        """Least squares, begun at what `current` found."""
        effects = {effect.name: effect for effect in self.candidates}
        return {name: with_effect(current, effects[name], self.rows) for name in names}

    def score(self, current: SensorFit, look: tuple[str, ...], fits: Mapping[str, SensorFit]) -> Mapping[str, Score]:
        """Gains counted in the independent samples that the closest of them leaves."""
        closest = min(fits.values(), key=lambda trial: trial.cost)
        effective = effective_samples(closest.residual[self.rows])
        scores = {}
        for name, trial in fits.items():
            gain = _gain(current, trial, effective)
            added = trial.unknowns - current.unknowns
            bar = extended(added, effective, len(self.candidates))
            scores[name] = Score(gain, gain, schwarz(added, effective), bar)
        return scores

    def coefficients(self, fit: SensorFit) -> Mapping[str, Mapping[str, Estimate]]:
        """With intervals that allow for a residual that is not white."""
        with np.errstate(invalid="ignore"):
            half = fit.half_widths(self.rows, effective_samples(fit.residual[self.rows]))
        ends = zip(fit.chain.names, fit.parameters.tolist(), half.tolist(), strict=True)
        known = {name: Estimate(value, value - off, value + off) for name, value, off in ends}
        return {effect.name: {c.name: known[c.name] for c in effect.coefficients} for effect in fit.chain.effects}

    def objection(self, current: SensorFit, name: str, trial: Trial[SensorFit]) -> str | None:
        """The held-out part must not be predicted worse by more than its noise floor."""
        before = current if current.chain.effects else self.line
        if trial.fit.rms(~self.rows) > math.hypot(before.rms(~self.rows), self.floor):
            return "fits the fitting part better and the held-out part worse"
        return None


def _open(effect: Effect, chain: Chain) -> bool:
    """Whether the effect may still be added: there is one limit and one low-pass, of whichever kind."""
    taken = {e.name for e in chain.effects}
    return not any(taken & alternatives for alternatives in _ALTERNATIVES if effect.name in alternatives) and (
        effect.name not in taken
    )


def with_effect(current: SensorFit, effect: Effect, rows: Rows) -> SensorFit:
    """The chain of `current` with one effect more, fitted to the rows."""
    chain = Chain((*current.chain.effects, effect), current.chain.record, current.chain.declared)
    bases = [current.parameters]
    if effect.stage is Stage.LIMIT:  # a line through samples at a limit is far from the line between the limits
        line = straight_line(chain.record, chain.declared, rows).parameters
        bases.append(np.concatenate([line, current.parameters[2:]]))
    starts = [np.concatenate([base, s]) for s in effect.starts(chain.record, chain.declared) for base in bases]
    return fit(chain, rows, starts)


def _gain(current: SensorFit, trial: SensorFit, effective: float) -> float:
    """Twice the gain of log-likelihood, counted in independent samples."""
    freedom = max(effective - trial.unknowns, 1.0)
    tiny = 1e-300  # a perfect fit has a gain, however large
    return freedom * math.log(max(current.cost, tiny) / max(trial.cost, tiny))
