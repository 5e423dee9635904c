"""What the closing scan answers."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from estimator.completeness.information import Information
from estimator.diagnosis import Interval


class Outcome(Enum):
    """What the record says of the model."""

    COMPLETE = "complete"
    LACKS = "lacks"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Lacking:
    """An effect that the record shows and the model lacks.

    coefficients by symbol, with their 95 % intervals, SI; evidence: twice the gain of log-likelihood once carried;
    angle [rad]: how far the reported angle is off without it, at most over the scored window, with its 95 % interval;
    of constants that were found together its share, the squares of which add up to what they do together; alike:
    effects that this record cannot tell from it.
    """

    effect: str
    title: str
    coefficients: Mapping[str, Interval]
    evidence: float
    angle: Interval
    alike: tuple[str, ...] = ()


@dataclass(frozen=True)
class Completeness:
    """The answer of the closing scan.

    reason: one line, why the outcome is what it is; lacks: largest first, those whose angle is too small to matter in
    `harmless`; information: what the record says of every coefficient of the catalogue, None where it could not be
    scanned; ratio: innovation over what was predicted of it, rms; samples: of the record that were looked at, seconds
    of it they span.
    """

    outcome: Outcome
    reason: str
    lacks: tuple[Lacking, ...] = ()
    harmless: tuple[Lacking, ...] = ()
    information: Information | None = None
    ratio: float | None = None
    samples: int = 0
    seconds: float = 0.0
