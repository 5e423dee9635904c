"""A record in short stretches: means of all that the figures of a data sheet are fitted to."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
HARMONICS = (1, 2, 3, 4)


@dataclass(frozen=True)
class Stretches:
    """Means over n stretches, in time order.

    t_s (n,) of their middles; rate (n,) rad/s put out; reference (n,) rad/s and its mean slope (n,) rad/s², None where
    nobody knows how the device turned; temperature (n,) °C or None; pattern (n, 16): means of cos kθ and sin kθ,
    k = 1 … 4, and of the reference times each, θ the pattern's angle in the device's frame; None of a device without;
    spread (n,) rad/s: standard deviation of the reference within each, None of none.
    """

    t_s: Floats
    rate: Floats
    reference: Floats | None = None
    slope: Floats | None = None
    temperature: Floats | None = None
    pattern: Floats | None = None
    spread: Floats | None = None

    def __len__(self) -> int:
        return self.t_s.size

    @property
    def moves(self) -> bool:
        """Whether the reference is other than one rate."""
        if self.reference is None or len(self) < 2:
            return False
        return bool(np.ptp(self.reference) > _as_still(self.reference))

    def still(self) -> list[tuple[int, int]]:
        """First and end of the stretches over which the reference stands still, again and again."""
        if self.reference is None or not self.moves:
            return [(0, len(self))]
        allowed, spread = _as_still(self.reference), np.zeros(len(self)) if self.spread is None else self.spread
        found, begin = [], 0
        least = most = float(self.reference[0])
        for k, (rate, within) in enumerate(zip(self.reference.tolist(), spread.tolist(), strict=True)):
            least, most = min(least, rate), max(most, rate)
            if within > allowed or most - least > allowed:
                found.append((begin, k))
                begin, least, most = k, rate, rate
            if within > allowed:
                begin, least, most = k + 1, np.inf, -np.inf
        return [(one, end) for one, end in [*found, (begin, len(self))] if end > one]


def _as_still(reference: Floats) -> float:
    return float(_STILL_RAD_S + _STILL * np.abs(reference).max())


_STILL_RAD_S, _STILL = 1e-6, 1e-3
"""A reference that moves by less, of itself or by a hundredth of the Earth's rate, stands still."""


def pattern_columns(theta: Floats, rate: Floats) -> Floats:
    """(n, 16): cos kθ, sin kθ, and the rate times each."""
    plain = np.column_stack([turn(k * theta) for k in HARMONICS for turn in (np.cos, np.sin)])
    return np.column_stack([plain, plain * rate[:, None]])


def joined(parts: list[Stretches]) -> Stretches:
    """Stretches of several records, one after another; what one of them lacks the whole lacks."""
    if len(parts) == 1:
        return parts[0]
    columns: dict[str, Any] = {}
    for name in ("t_s", "rate", "reference", "slope", "temperature", "pattern", "spread"):
        values = [getattr(part, name) for part in parts]
        columns[name] = None if any(one is None for one in values) else np.concatenate(values)
    return Stretches(**columns)


class Gathered:
    """Sums over stretches of `ticks` ticks, of samples that come in blocks."""

    def __init__(self, ticks: int, tick_rate_Hz: float, columns: int) -> None:
        self.ticks, self._rate_Hz = ticks, tick_rate_Hz
        self._sums: dict[int, Floats] = {}
        self._columns = columns

    def add(self, tick: npt.NDArray[np.int64], *columns: Floats) -> None:
        """Samples at rising ticks, (n,) of each column."""
        first, last = int(tick[0]) // self.ticks, int(tick[-1]) // self.ticks
        begins = np.searchsorted(tick, np.arange(first, last + 1) * self.ticks)
        counts = np.diff(begins, append=tick.size)
        there = counts > 0
        sums = np.column_stack([counts[there], *(np.add.reduceat(one, begins[there]) for one in columns)])
        for place, own in zip((np.flatnonzero(there) + first).tolist(), sums, strict=True):
            self._sums[place] = self._sums[place] + own if place in self._sums else own

    def means(self) -> tuple[Floats, Floats]:
        """Middle of each stretch (n,) [s] and its means (n, columns); those with half their samples or more."""
        if not self._sums:
            return np.zeros(0), np.zeros((0, self._columns))
        rows = np.array([(place, *sums) for place, sums in self._sums.items()])
        full = rows[:, 1] >= 0.5 * rows[:, 1].max()
        rows = rows[full]
        return (rows[:, 0] + 0.5) * self.ticks / self._rate_Hz, rows[:, 2:] / rows[:, 1:2]
