"""The records of a pool, and what their covariate is."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from estimator.errors import ModelError
from estimator.identification.problem import Effects, Problem
from estimator.record import Record
from estimator.settings import Device, ObserverSettings


@dataclass(frozen=True)
class Member:
    """A record, what it is called, and its covariate, in the covariate's own unit."""

    name: str
    record: Record
    covariate: float = 0.0


@dataclass(frozen=True)
class Pool:
    """Records of one device; `covariate` names what was other on each, None where nothing is said to have been;
    `asked` are candidates that are tried only where they are asked for (`Effect.on_request`), `begun` those for which a
    line was looked for, with where they begin.
    """

    members: tuple[Member, ...]
    device: Device
    settings: ObserverSettings
    covariate: str | None = None
    asked: tuple[str, ...] = ()
    begun: Effects = field(default_factory=dict)

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Each record by itself."""
        return tuple(Problem(member.record, self.device, self.settings, asked=self.asked) for member in self.members)

    def of(self, members: Sequence[Member]) -> "Pool":
        """The same device with these records."""
        return replace(self, members=tuple(members))


@dataclass(frozen=True)
class Level:
    """Where the covariate counts from, and what one of it is: mean and spread over the records that are fitted."""

    mean: float
    spread: float

    @classmethod
    def of(cls, pool: Pool) -> "Level":
        """Of the records of a pool. Raises ModelError where the covariate is the same on all of them."""
        values = np.array([member.covariate for member in pool.members])
        if pool.covariate is None:
            return cls(0.0, 1.0)
        if np.ptp(values) <= 1e-9 * np.max(np.abs(values)):
            raise ModelError(
                f"{pool.covariate} is {values[0]:g} on every record that is fitted; hold out other ones, or leave "
                "--covariate out"
            )
        return cls(float(np.mean(values)), float(np.std(values)))

    def scaled(self, covariate: float) -> float:
        """A covariate, counted so."""
        return (covariate - self.mean) / self.spread


@dataclass(frozen=True)
class Rows:
    """Of each record the samples that count (n,), as masks."""

    masks: tuple[NDArray[np.bool_], ...]


def held_out_by_default(pool: Pool) -> tuple[int, ...]:
    """Which records judge where nobody says: a third of them, at least one, evenly among the covariates' order and,
    where there are enough, neither the first nor the last of it.
    """
    number = len(pool.members)
    order = sorted(range(number), key=lambda i: (pool.members[i].covariate, i))
    inner = order[1:-1] if number > 3 else order
    wanted = max(number // 3, 1)
    places = (np.arange(wanted) + 0.5) * len(inner) / wanted
    return tuple(sorted(inner[int(place)] for place in places))
