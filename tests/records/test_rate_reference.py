"""The error of angle and rate beside a rate that a record has itself, by a hand-made pair of records."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.records.rate_reference import errors

RATE, N = 100.0, 1000
T = np.arange(N) / RATE
TURNS = 0.5 * np.sin(1.3 * T) + 0.2


class Columns(dict[str, Any]):
    """Some rows of estimates, every fourth sample."""

    def __init__(self, **columns: Any) -> None:
        super().__init__(columns)
        self.tick = np.arange(3, N, 4)

    def __len__(self) -> int:
        return len(self.tick)

    @property
    def t_s(self) -> Any:
        return self.tick / RATE

    def between(self, first: int, last: int) -> "Columns":
        keep = (self.tick >= first) & (self.tick <= last)
        part = Columns(**{name: values[keep] for name, values in self.items()})
        part.tick = self.tick[keep]
        return part


def capture() -> Any:
    """In two pieces."""

    def piece(rows: slice) -> Any:
        return SimpleNamespace(tick=np.arange(N)[rows], t_s=T[rows], rate_rad_s=TURNS[rows])

    return SimpleNamespace(rate_rad_s=TURNS, pieces=lambda: iter([piece(slice(0, 333)), piece(slice(333, N))]))


def test_an_angle_and_a_rate_that_are_off() -> None:
    """By a constant, which an angle is not charged for, by a drift of 0.01 rad/s, and by 0.03 rad/s."""
    rows = np.arange(3, N, 4)
    true = (0.5 / 1.3) * (1.0 - np.cos(1.3 * T)) + 0.2 * T
    found = errors(capture(), Columns(angle_rad=true[rows] + 7.0 + 0.01 * T[rows], rate_rad_s=TURNS[rows] + 0.03), 2.0)  # type: ignore[arg-type]
    scored = T[rows][T[rows] >= 2.0]
    assert found.angle_rms_rad == pytest.approx(0.01 * np.sqrt(np.mean((scored - scored[0]) ** 2)), rel=1e-3)
    assert found.rate_rms_rad_s == pytest.approx(0.03)


def test_there_is_none_without_a_reference_or_an_angle() -> None:
    none = SimpleNamespace(rate_rad_s=None)
    assert errors(none, Columns(angle_rad=np.zeros(249)), 0.0) == (None, None)  # type: ignore[arg-type]
    assert errors(capture(), Columns(kxx=np.zeros(len(np.arange(3, N, 4)))), 0.0) == (None, None)  # type: ignore[arg-type]
    assert errors(capture(), None, 0.0) == (None, None)
