"""Whether the device is the same at a small amplitude and at a large one, and under a small drive and a large one."""

from collections.abc import Iterator

import numpy as np

from estimator.identify.fit import Fitted, fit
from estimator.identify.model import NAMES, Piece
from estimator.identify.schedule import Table
from hil.identifying.recording import Sampled
from hil.numbers import signed

_SURE = 4.0  # standard deviations of a difference
_TOLD = {"kxx": "stiffness of x", "kyy": "stiffness of y", "dxx": "damping of x", "dyy": "damping of y"}
_SMALL = ("small decay x", "small decay y")
_LARGE = ("ring-down",)


def amplitude_dependence(record: Sampled, table: Table, found: Fitted) -> Iterator[str]:
    """A line for each constant that differs between the decays from small bursts and the ring-down, and by how much."""
    small, large = ([_decay(record, table, name) for name in names] for names in (_SMALL, _LARGE))
    if any(part is None for part in (*small, *large)):
        return
    free = [NAMES.index(name) for name in _TOLD]
    values = []
    for parts in (small, large):
        try:
            one = fit([part for part in parts if part is not None], found.theta, only=tuple(free), noise=found.noise)
        except np.linalg.LinAlgError:
            return
        values.append((one.theta[free], np.diag(one.covariance)[free]))
    difference = values[1][0] - values[0][0]
    u = np.sqrt(values[0][1] + values[1][1] + 1e-300)
    for name, by, of, spread in zip(_TOLD, difference, found.theta[free], u, strict=True):
        if abs(by) > _SURE * spread:
            yield (
                f"{_TOLD[name]} differs by {signed(100.0 * by / of)} % (± {200.0 * spread / abs(of):.1g} %) between a "
                "large and a small amplitude: hil trace names the effect"
            )


def _decay(record: Sampled, table: Table, name: str) -> Piece | None:
    """The free motion behind a burst; None where samples are missing."""
    rows = table.rows_of(name)
    begin = int(np.flatnonzero(np.nan_to_num(record.drive).any(axis=1))[-1]) + 12 if name == "ring-down" else None
    there = slice(rows.start + 40, min(rows.stop, len(record.sense)))
    if begin is not None:
        there = slice(max(begin, there.start), there.stop)
    part = Piece(record.sense[there], record.drive[there])
    whole = len(part.sense) > 500 and np.isfinite(part.sense).all() and not np.nan_to_num(part.drive).any()
    return part if whole else None
