"""Many records together: errors pooled, and who is the best rival."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hil.comparing.observers import RATE_IDENTIFIED
from hil.records.methods import Methods


@dataclass(frozen=True)
class Pooled:
    """A method over records: rms of the errors' rms, and those of each record; how often it diverged."""

    name: str
    kind: str
    angle: float
    rate: float | None
    stiffness: float | None
    angles: tuple[float, ...]
    diverged: int
    settled: tuple[float, ...]
    cost_us: float | None


def pooled(found: Sequence[Methods]) -> list[Pooled]:
    """Every method, in the order of the tables.  An error that is no number counts as endless."""
    tables = []
    for name in dict.fromkeys(row.name for methods in found for row in methods.rows):
        rows = [methods.of(name) for methods in found]
        angles = tuple(math.inf if row.angle_error_rms_rad is None else row.angle_error_rms_rad for row in rows)
        costs = [row.cost_us for row in rows if row.cost_us is not None]
        tables.append(
            Pooled(
                name=name,
                kind=rows[0].kind,
                angle=_rms(angles),
                rate=_of([row.rate_error_rms_rad_s for row in rows]),
                stiffness=_of([row.stiffness_error for row in rows]),
                angles=angles,
                diverged=sum(row.diverged_s is not None for row in rows),
                settled=tuple(row.settled_s for row in rows if row.settled_s is not None),
                cost_us=min(costs) if costs else None,
            )
        )
    return tables


def rivalry(found: Sequence[Methods], ours: str) -> dict[str, tuple[str, float, float, float]]:
    """Best of the prior art over ours by the pooled angle error, without and with the rate identified in windows that
    let no offset through: who it is, the ratio, and the least and largest ratio of one record.
    """
    tables = pooled(found)
    own = next(row for row in tables if row.name == ours)
    answers = {}
    for what, left_out in (("best of (a)–(e) as published", {RATE_IDENTIFIED}), ("best of all", set())):
        rivals = [row for row in tables if row.kind == "prior art" and row.name not in left_out]
        best = min(rivals, key=lambda row: row.angle)
        each = [theirs / mine for theirs, mine in zip(best.angles, own.angles, strict=True)]
        answers[what] = (best.name, best.angle / own.angle, min(each), max(each))
    return answers


def _of(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return _rms(known) if len(known) == len(values) else None


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(sum(value * value for value in values) / len(values))
