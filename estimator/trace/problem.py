"""What tracing is asked: a record, and what its bench declares of the device, the observer and the control."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from estimator.record import Record
from estimator.settings import ControllerSettings, Device, ObserverSettings

Effects = Mapping[str, Mapping[str, float]]
"""By name, each with its coefficients and parameters, SI."""

Progress = Callable[[str, int, int], None]
"""Told of a stage how much of it is done, of how much."""


def unseen(stage: str, done: int, total: int) -> None:
    """Nobody looks on."""


@dataclass(frozen=True)
class Problem:
    """A record and the observer that is to follow it; `controller` None where no control was at work or none is known.

    The effects that the observer carries are those of its settings.  scored_from: of the record, s, from where on its
    angle is reported; None: from where the observer has settled.
    """

    record: Record
    device: Device
    settings: ObserverSettings
    controller: ControllerSettings | None = None
    scored_from: float | None = None

    @property
    def effects(self) -> Effects:
        """What the observer carries beside the base model."""
        return self.settings.effects

    @property
    def span(self) -> float:
        """Length of the record, s."""
        return float(self.record.step.sum())

    def part(self, rows: slice) -> "Problem":
        """The same of these samples only."""
        return replace(self, record=self.record.part(rows))

    def on(self, record: Record) -> "Problem":
        """The same of another record."""
        return replace(self, record=record)

    def under(self, settings: ObserverSettings) -> "Problem":
        """The same with another observer, and the effects that it carries."""
        return replace(self, settings=settings)

    def carrying(self, effects: Effects) -> "Problem":
        """The same with these effects in place of those so far."""
        carried = {name: dict(given) for name, given in effects.items()}
        return self.under(replace(self.settings, effects=carried))
