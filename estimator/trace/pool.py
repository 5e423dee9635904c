"""Several records of one device: what each is called, what its covariate is, which of them judge."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.errors import ModelError
from estimator.record import Record
from estimator.settings import ControllerSettings, Device, ObserverSettings
from estimator.trace.problem import Problem

FEWEST = 2
"""Records that are fitted, at least: of one alone, its own and the device's are one thing."""
SAME = 1e-9
"""Of the largest: covariates that differ by less are one value."""


@dataclass(frozen=True)
class Member:
    """A record, what it is called, and its covariate, in the covariate's own unit."""

    name: str
    record: Record
    covariate: float = 0.0


@dataclass(frozen=True)
class Pool:
    """Records of one device; `covariate` names what was other on each, None where nothing is said to have been;
    `controller` where one was at work on all of them; scored_from: as of a `Problem`, of each record.
    """

    members: tuple[Member, ...]
    device: Device
    settings: ObserverSettings
    covariate: str | None = None
    controller: ControllerSettings | None = None
    scored_from: float | None = None

    def of(self, members: Sequence[Member]) -> "Pool":
        """The same device with these records."""
        return replace(self, members=tuple(members))

    def problem(self, member: Member) -> Problem:
        """A record by itself."""
        return Problem(member.record, self.device, self.settings, self.controller, self.scored_from)

    @property
    def hardest(self) -> Problem:
        """The record that is driven hardest, by itself."""

        def force(member: Member) -> float:
            return float(np.max(np.abs(member.record.drive), initial=0.0))

        return self.problem(max(self.members, key=force))

    def divided(self, held_out: Sequence[int]) -> tuple["Pool", "Pool"]:
        """The records that are fitted, and those that judge.  Raises ModelError where either are too few."""
        fit = self.of([member for i, member in enumerate(self.members) if i not in held_out])
        judges = self.of([self.members[i] for i in sorted(held_out)])
        if len(fit.members) < FEWEST or not judges.members:
            raise ModelError(
                f"{len(fit.members)} records to fit and {len(judges.members)} to judge; give {FEWEST} of the former "
                "and one of the latter at least"
            )
        return fit, judges


@dataclass(frozen=True)
class Level:
    """Where a covariate counts from, and what one of it is: mean and spread over the records that are fitted."""

    covariate: str | None = None
    mean: float = 0.0
    spread: float = 1.0

    @classmethod
    def of(cls, pool: Pool) -> "Level":
        """Of the records of a pool.  Raises ModelError where the covariate is the same on all of them."""
        values = np.array([member.covariate for member in pool.members])
        if pool.covariate is None:
            return cls()
        if np.ptp(values) <= SAME * np.max(np.abs(values)):
            raise ModelError(
                f"{pool.covariate} is {values[0]:g} on every record that is fitted; hold out other ones, or leave "
                "--covariate out"
            )
        return cls(pool.covariate, float(np.mean(values)), float(np.std(values)))

    def scaled(self, covariate: float) -> float:
        """A covariate, counted so."""
        return (covariate - self.mean) / self.spread


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
