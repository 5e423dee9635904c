"""A likelihood that is linear in every parameter, of which least squares says all in closed form."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from estimator.effects.declaration import Coefficient, Compensation, Effect
from estimator.model.formula import symbols
from estimator.trace.examination import Examination
from estimator.trace.fit import FittedModel, fit
from estimator.trace.likelihood import BLOCKS, Evaluation, Layout, Model, Noise
from estimator.trace.problem import Effects
from tests.trace.plain import Array

WIDE = 1e4
"""Prior deviation of all parameters: beside it a record of some thousand samples says all."""


def effect(name: str, coefficients: int, *, plausible: float = WIDE, positive: bool = False) -> Effect:
    """An effect of that many coefficients, called `name` and a number."""
    names = [f"{name}{k}" for k in range(coefficients)]
    own = tuple(Coefficient(symbols(f"{n} _")[0], n, plausible, positive=positive) for n in names)
    return Effect(
        name, f"Effect {name}", own, "a book", "none", Compensation.NONE,
    )  # fmt: skip


class Parameters(Layout):
    """Of base columns b0, b1, … and effects."""

    def __init__(self, base: int, effects: Effects, declared: dict[str, Effect]) -> None:
        self.effects = tuple(declared[name] for name in effects)
        coefficients = [(one.name, c) for one in self.effects for c in one.coefficients]
        self.owner = (*[""] * base, *(name for name, _ in coefficients))
        self.names = (*(f"b{k}" for k in range(base)), *(c.name for _, c in coefficients))
        self.factor, self.mean = np.ones(len(self.names)), np.zeros(len(self.names))
        self.deviation = np.array([*[WIDE] * base, *(c.plausible for _, c in coefficients)])
        self.least = np.array([*[-np.inf] * base, *(c.least for _, c in coefficients)])
        self.most = np.full(len(self.names), np.inf)

    def effects_of(self, model: Model) -> Effects:
        return model.effects


@dataclass(frozen=True)
class Linear:
    """y (n,) = base (n, k) θ + noise of deviation 1, and the columns (n, c) of effects that may be in it."""

    y: Array
    base: Array
    columns: dict[str, Array]
    declared: dict[str, Effect]
    effects: Effects = field(default_factory=dict)
    axes: int = 1

    @property
    def samples(self) -> int:
        return len(self.y)

    @property
    def first(self) -> int:
        return len(self.y)

    @property
    def most(self) -> int:
        return 4

    @property
    def following(self) -> "Linear":
        return self

    def disturbed(self, layout: Layout, model: Model) -> tuple[Model, Model]:
        return model, model

    def examined(self, constants: Mapping[str, float], effects: Effects, split: int) -> Examination:
        raise AssertionError("no observer here")

    def above_floor(self, held_out: Evaluation, after: Examination | None) -> float:
        return float(np.sqrt(held_out.scale))

    def part(self, rows: slice) -> "Linear":
        columns = {name: one[rows] for name, one in self.columns.items()}
        return replace(self, y=self.y[rows], base=self.base[rows], columns=columns)

    def layout(self, effects: Effects) -> Layout:
        return Parameters(self.base.shape[1], effects, self.declared)

    def effect(self, name: str) -> Effect:
        return self.declared[name]

    def plausible(self, name: str) -> Array:
        return np.array([one.plausible for one in self.declared[name].coefficients])

    def begun(self, layout: Layout, theta: Array, name: str, size: Array) -> Array:
        theta = theta.copy()
        theta[layout.of(name)] = np.maximum(size, layout.least[layout.of(name)])
        return theta

    def declared_noise(self) -> Noise:
        return Noise((1.0,), 1.0, 0.0)

    def at_first(self, layout: Layout, model: Model) -> Model:
        return model

    def quieten(self, layout: Layout, model: Model) -> Model:
        return model

    def fit_noise(self, layout: Layout, model: Model) -> Model:
        return model

    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        return {name: {} for name in self.columns if name not in model.effects}

    def evaluate(
        self, layout: Layout, model: Model, *, derivatives: bool = True, tested: Effects | None = None
    ) -> Evaluation:
        tested = tested or {}
        used = np.column_stack([self.base, *(self.columns[name] for name in model.effects)])
        e = self.y - used @ model.theta
        names = [*(layout.names if derivatives else ()), *(n for n in tested for _ in self.declared[n].coefficients)]
        psi = np.column_stack([used if derivatives else used[:, :0], *(self.columns[name] for name in tested)])
        parts = np.array_split(np.arange(len(e)), BLOCKS)
        return Evaluation(
            tuple(names), np.array([psi[rows].T @ e[rows] for rows in parts]),
            np.array([psi[rows].T @ psi[rows] for rows in parts]), np.array([e[rows] @ e[rows] for rows in parts]),
            np.zeros(BLOCKS), np.array([float(len(rows)) for rows in parts]), e[:, None], np.ones((len(e), 1)),
        )  # fmt: skip


def made(
    columns: dict[str, Array], truth: dict[str, list[float]], *, n: int = 2000, seed: int = 0, **given: bool
) -> Linear:
    """A record of two base columns and what `truth` has of the effects."""
    rng = np.random.default_rng(seed)
    base = rng.standard_normal((n, 2))
    y = base @ [1.5, -0.5] + rng.standard_normal(n)
    for name, size in truth.items():
        y = y + columns[name] @ np.array(size)
    return Linear(y, base, columns, {name: effect(name, one.shape[1], **given) for name, one in columns.items()})


def fitted(of: Linear, *effects: str) -> FittedModel:
    """With these effects."""
    return fit(of, {key: {} for key in effects})
