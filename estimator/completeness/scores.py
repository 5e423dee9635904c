"""What a pass over the record says of every coefficient beside a fitted model."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimator.completeness.stretched import Stretched
from estimator.scaling import Array
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import Evaluation
from estimator.trace.problem import Effects
from estimator.trace.score_test import Score, projected, scores_in, tested_in

SAME = 0.9992
"""Likeness of what two effects do to the innovations above which a record does not tell them apart."""


@dataclass(frozen=True)
class Scores:
    """Normal equations of coefficients, all of which are zero in the model that they are about; in plausible sizes.

    columns: those of each effect, first the constants that the model has; normal (k, k), score (k,): with what the
    model fits beside the constants projected out; plausible (k,) SI sizes; table: each effect that the model has not,
    beside the constants as they are known, the largest gain first; ratio: innovation over what was predicted of it,
    rms; widening: by how much deviations are larger than the equations say; samples: of both axes together.
    """

    columns: Mapping[str, slice]
    normal: Array
    score: Array
    plausible: Array
    table: tuple[Score, ...]
    ratio: float
    widening: float
    samples: int

    def alike(self, name: str, values: Array) -> list[str]:
        """Effects that could do the same to this record as `name` with these coefficients (c,), SI."""
        columns = self.columns[name]
        own, c = self.normal[columns, columns], values / self.plausible[columns]
        size = float(c @ own @ c)
        found = []
        for other, others in self.columns.items():
            if other == name or not size > 0.0:
                continue
            cross = self.normal[others, columns] @ c
            same = float(cross @ np.linalg.pinv(self.normal[others, others], rcond=1e-9, hermitian=True) @ cross)
            if same > SAME**2 * size:
                found.append(other)
        return found


def scores_of(of: Stretched, model: FittedModel, tested: Effects, constants: Collection[str]) -> Scores:
    """The scores of `tested`, and of the constants, effects that the model has and that are known to be small: of
    these the equations are about zero, to which the score is carried over by their information.
    """
    seen = of.evaluate(model.layout, model.model, tested=tested)
    layout, scale = model.layout, seen.scale
    own, size = len(layout.names), len(seen.names)
    ours = [k for name in constants for k in layout.of(name)]
    fitted = [k for k in range(own) if k not in ours]
    columns = _columns([*(layout.owner[k] for k in ours), *seen.names[own:]])
    sizes = np.concatenate([of.plausible(name) for name in columns])
    factor = [*layout.factor[ours], *_factors(of, tested)]
    kept = [*fitted, *ours, *range(own, size)]
    left, slopes = projected(
        (seen.information / scale)[:, kept][:, :, kept], _slopes(model, seen, fitted)[:, kept], layout.deviation[fitted]
    )
    normal = left.sum(axis=0) * np.outer(sizes, sizes)
    at_model = slopes.sum(axis=0) * sizes
    about_zero = at_model + normal[:, : len(ours)] @ (model.model.theta[ours] / sizes[: len(ours)])
    return Scores(
        columns, normal, -about_zero, sizes * np.abs(factor), _table(of, model, seen, tested), ratio_of(seen),
        float(np.sqrt(max(scale, 1.0) * model.scatter)), seen.innovation.size,
    )  # fmt: skip


def _slopes(model: FittedModel, seen: Evaluation, of: list[int]) -> Array:
    """Scores (parts, size) less the slope of what is known beforehand of these parameters."""
    layout, slopes = model.layout, seen.score / seen.scale
    pull = (model.model.theta[of] - layout.mean[of]) / layout.deviation[of] ** 2
    slopes[:, of] -= pull / len(slopes)
    return slopes


def _columns(names: list[str]) -> dict[str, slice]:
    columns: dict[str, slice] = {}
    for k, name in enumerate(names):
        columns[name] = slice(columns[name].start if name in columns else k, k + 1)
    return columns


def _factors(of: Stretched, tested: Effects) -> list[float]:
    """SI of a scaled unit of each coefficient."""
    return [of.unit(coefficient) for name in tested for coefficient in of.effect(name).coefficients]


def _table(of: Stretched, model: FittedModel, seen: Evaluation, tested: Effects) -> tuple[Score, ...]:
    """Each effect beside everything that the model has."""
    own = len(model.layout.names)
    beside = replace(tested_in(seen, own, seen.scale), score=_slopes(model, seen, list(range(own))))
    return tuple(sorted(scores_in(of, beside, model.layout.deviation, tested), key=lambda one: -one.gain))


def ratio_of(seen: Evaluation) -> float:
    """Innovation over what was predicted of it, rms; NaN where nothing was measured."""
    with np.errstate(all="ignore"):
        normalised = (seen.innovation / seen.deviation) ** 2
    return float(np.sqrt(np.nanmean(normalised))) if np.isfinite(normalised).any() else float("nan")
