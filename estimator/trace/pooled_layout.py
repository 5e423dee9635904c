"""The parameters of several records: shared, each record's own, and slopes against a covariate."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.scaling import Array
from estimator.trace.filtered import Filtered
from estimator.trace.free_run import StartLayout
from estimator.trace.likelihood import Layout, Model, ObserverLayout, Size
from estimator.trace.pool import Level
from estimator.trace.problem import Effects

_BY = " by "
_OF = " of "


class Part(NamedTuple):
    """A record of a pool: its name, its own likelihood, its covariate as it is and as it is counted."""

    name: str
    of: Filtered
    covariate: float
    z: float


class Dependence(NamedTuple):
    """A constant or coefficient that goes with the covariate, as search and checks know an effect: by how much."""

    coefficients: tuple[Size, ...]
    signals: tuple[object, ...] = ()


def dependence(constant: str, covariate: str) -> str:
    """What the candidate is called that a constant or a coefficient depends on the covariate."""
    return f"{constant}{_BY}{covariate}"


def constant_of(candidate: str) -> str | None:
    """The constant of such a candidate; None for an effect."""
    return candidate.partition(_BY)[0] if _BY in candidate else None


def of_records(effects: Effects) -> dict[str, dict[str, float]]:
    """The effects that each record has; not what goes with the covariate."""
    return {name: dict(given) for name, given in effects.items() if constant_of(name) is None}


def own_name(name: str, record: str) -> str:
    """What a record's own entry is called."""
    return f"{name}{_OF}{record}"


class PooledLayout(Layout):
    """The parameters of a pool: those of one record, with an entry each of what is a record's own (its start, what an
    effect has of where a record begins), and slopes.

    A record's parameters are a linear map (k of the record, K) of the pool's.  varying: constants with a slope.
    """

    def __init__(self, parts: Sequence[Part], level: Level, effects: Effects) -> None:
        self.given, self.level = of_records(effects), level
        alone = [self._alone(part) for part in parts]
        self.first = first = alone[0]
        self.records = tuple(part.name for part in parts)
        self.common = len(first.names) - len(_starts(first))
        figures: dict[tuple[str, str, str], list[float]] = {}  # by owner, name, and record of what is its own

        def enter(layout: ObserverLayout, k: int, record: str, deviation: float) -> None:
            figures[layout.owner[k], layout.names[k], record] = [
                layout.mean[k], deviation, layout.least[k], layout.most[k], layout.factor[k]
            ]  # fmt: skip

        for k in range(self.common):
            for record in self.records if is_own(first, k) else ("",):
                enter(first, k, record, max(float(layout.deviation[k]) for layout in alone))
        self.tilted: dict[int, tuple[int, int]] = {}  # place of a slope: of its constant here and in a record
        slopes = [(name, constant) for name in effects if (constant := constant_of(name)) is not None]
        for name, constant in slopes:
            for k in [k for k in range(self.common) if first.names[k] == constant and not is_own(first, k)][:1]:
                own = first.owner[k], constant, ""
                self.tilted[len(figures)] = list(figures).index(own), k
                figures[name, constant, ""] = [0.0, figures[own][1], -np.inf, np.inf, figures[own][4] / level.spread]
        for part, layout in zip(parts, alone, strict=True):
            for k in _starts(layout):
                enter(layout, k, part.name, float(layout.deviation[k]))
        self.places = {key: place for place, key in enumerate(figures)}
        self.names = tuple(own_name(name, record) if record else name for _, name, record in figures)
        self.owner = tuple(owner for owner, _, _ in figures)
        self.own = [place for (_, _, record), place in self.places.items() if record]
        self.start = [place for place in self.own if not self.owner[place]]
        self.mean, self.deviation, self.least, self.most, self.factor = np.array(list(figures.values())).T.copy()
        self.varying = frozenset(constant for _, constant in slopes)
        self._maps = {part.name: (layout, self._map(layout, part)) for part, layout in zip(parts, alone, strict=True)}

    def _alone(self, part: Part) -> ObserverLayout:
        layout = part.of.layout(self.given)
        assert isinstance(layout, ObserverLayout)
        return layout

    @property
    def linear(self) -> list[str]:
        """Shared constants and coefficients that may go with a covariate: one of each name."""
        first = range(len(self.first.index))
        return [self.first.names[k] for k in first if not is_own(self.first, k) and ":" not in self.first.names[k]]

    def of_record(self, part: Part) -> tuple[ObserverLayout, Array]:
        """The layout of a record, and the map to its parameters; of one that was not fitted, what is its own is the
        mean of those that were.
        """
        if part.name not in self._maps:
            layout = self._alone(part)
            self._maps[part.name] = layout, self._map(layout, part)
        return self._maps[part.name]

    def _map(self, layout: ObserverLayout, part: Part) -> Array:
        whole = np.zeros((len(layout.names), len(self.names)))
        for k, (owner, name) in enumerate(zip(layout.owner, layout.names, strict=True)):
            if k < self.common and not is_own(layout, k):
                whole[k, self.places[owner, name, ""]] = 1.0
                continue
            whose = [part.name] if part.name in self.records else list(self.records)
            found = [self.places[key] for one in whose if (key := (owner, name, one)) in self.places]
            whole[k, found] = 1.0 / max(len(found), 1)
        for place, (_, k) in self.tilted.items():
            whole[k, place] = part.z
        return whole

    @property
    def constants(self) -> list[int]:
        """Places of the base model's constants, which the records share."""
        return [place for place in self.shared if not self.owner[place]]

    @property
    def shared(self) -> list[int]:
        own = set(self.own)
        return [place for place in range(len(self.names)) if place not in own]

    def spread(self, share: float) -> Array:
        """As `Layout.spread`; the start of each record in full."""
        spread = np.array(super().spread(share))
        spread[self.start] = self.deviation[self.start]
        return spread

    def bounded(self, theta: Array) -> Array:
        """... with what a record's own layout bounds of its parameters by one another."""
        theta = super().bounded(theta)
        alone = self._maps[self.records[0]][1] @ theta
        bounded = self.first.bounded(alone)
        for k in range(self.common):
            if bounded[k] != alone[k] and not is_own(self.first, k):
                theta[self.places[self.first.owner[k], self.first.names[k], ""]] = bounded[k]
        return theta

    def effects_of(self, model: Model) -> Effects:
        alone = Model(self.given, self._maps[self.records[0]][1] @ model.theta, model.noise)
        found = self.first.effects_of(alone)
        return {name: dict(found.get(name, {})) for name in model.effects}


def _starts(layout: ObserverLayout) -> list[int]:
    """Places of where a record begins."""
    return [int(k) for k in layout.start] if isinstance(layout, StartLayout) else []


def is_own(layout: ObserverLayout, k: int) -> bool:
    """Whether a parameter of a record is its own, as what hangs on where it begins."""
    owner, name = layout.owner[k], layout.names[k]
    whose = (effect for effect in layout.effects if effect.name == owner)
    return any(c.own and c.name == name for effect in whose for c in effect.coefficients)
