"""The truth an emulated board wrote about itself. Opened by the score only, after the run."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.records.estimates import Estimates
from hil.records.table import Table

Floats = npt.NDArray[np.float64]

_CODES = ("vx_code", "vy_code", "ux_code", "uy_code")
_REQUIRED = ("tick", "x_m", "vx_mps", "phi_x_V", "rate_rad_s", "angle_rad")


@dataclass(frozen=True)
class Truth(Table):
    """True state at sampling instants: columns (n,) named as in the estimates, and `angle_rad` = ∫Ω dt."""

    KIND = "truth"

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        return self.columns[name]

    @property
    def constants(self) -> dict[str, float]:
        """Stiffness and damping per unit mass, by the name of the estimate they belong to; a trimmed stiffness is a
        column."""
        stiffness = zip(("kxx_per_s2", "kyy_per_s2", "kxy_per_s2"), self.header["stiffness_per_s2"], strict=False)
        damping = zip(("dxx_per_s", "dyy_per_s", "dxy_per_s"), self.header["damping_per_s"], strict=False)
        return {name: float(value) for name, value in (*stiffness, *damping) if name not in self.columns}

    def coefficients(self, effects: Collection[str]) -> dict[str, float]:
        """Coefficients of those hidden effects that are among `effects`, by their symbols, which board and observer
        share. None where the sense gain of x is off (gx): it scales the unit of length that they are counted in.
        """
        hidden = {one["name"]: one["coefficients"] for one in self.header.get("effects", ())}
        if any(coefficients.get("gx", 0.0) for coefficients in hidden.values()):
            return {}
        return {symbol: float(value) for name in hidden.keys() & effects for symbol, value in hidden[name].items()}

    @property
    def codes(self) -> tuple[str, ...]:
        """Columns of codes as sent, by which a truth is known to be that of a run; none in old files."""
        return tuple(name for name in _CODES if name in self.columns)

    @property
    def spacing(self) -> int:
        """Ticks from one row to the next, as its last two have it."""
        last = self.part(len(self) - 2, len(self)).tick if len(self) > 1 else (0, 1)
        return int(last[1] - last[0])

    def beside(self, estimates: Estimates) -> Iterator[tuple[int, Estimates, "Truth"]]:
        """Both in parts of the same stretch of ticks, neither large, with the first row of the estimates' part."""
        row = 0
        for piece in estimates.pieces():
            tick = piece.tick
            for part in self.between(int(tick[0]), int(tick[-1])).pieces():
                true = part.tick
                first, stop = np.searchsorted(tick, (true[0], true[-1] + 1))
                yield row + int(first), piece.part(int(first), int(stop)), part
            row += tick.size

    def on(self, tick_rate_Hz: float, place: Path) -> "Truth":
        """The same by the ticks of a record of another rate; rows that are none of its ticks are left out.  Raises
        InputError where its ticks are none of the truth's.
        """
        ratio = self.tick_rate_Hz / tick_rate_Hz
        every = max(round(ratio), 1)
        if abs(ratio / every - 1.0) > 1e-6:
            raise InputError(
                f"{place}: at {self.tick_rate_Hz:g} Hz, no whole multiple of the record's {tick_rate_Hz:g} Hz; "
                "demodulate at a rate that divides the board's"
            )
        rows = np.flatnonzero(self.tick % every == 0)
        columns = {name: self.columns[name][rows] for name in self.columns if name not in _CODES}
        return Truth(
            {**columns, "tick": columns["tick"] // every}, {**self.header, "tick_rate_Hz": tick_rate_Hz}, self.complete
        )

    def at(self, tick: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Indices (into `tick`, into this truth) of the ticks both have, ascending."""
        _, theirs, ours = np.intersect1d(tick, self.tick, assume_unique=True, return_indices=True)
        return theirs, ours

    def _flaw(self) -> str:
        missing = [name for name in _REQUIRED if name not in self.columns]
        missing += [key for key in ("stiffness_per_s2", "damping_per_s", "sample_rate_Hz") if key not in self.header]
        return f"a truth file without {', '.join(missing)}; have the emulator write it again" if missing else ""


read_truth = Truth.read
