"""`innovation.arrow`: measured minus predicted voltage at every sample, and how large it should have been."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hil.records.layout import TICK, Column, Layout, block_rows_for
from hil.records.quantiles import quantiles
from hil.records.table import Table

_AXES = ("x", "y")

WIDE = 1.5
"""A prediction that is less sure than usual by more than this comes behind a gap, or before the motion is known."""


def innovation_layout(*, tick_rate_Hz: float, axes: int, sense_unit: str = "V") -> Layout:
    """Columns tick, nu_x_V (nu_y_V), s_x_V (s_y_V), the latter the predicted standard deviations; their unit is that of
    what is sensed, whatever the name says.
    """
    names = _AXES[:axes]
    columns = (
        TICK,
        *(Column(f"nu_{axis}_V", "f4", sense_unit) for axis in names),
        *(Column(f"s_{axis}_V", "f4", sense_unit) for axis in names),
    )
    header = {"tick_rate_Hz": tick_rate_Hz, "axes": axes}
    return Layout("innovation", columns, block_rows_for(tick_rate_Hz), header)


@dataclass(frozen=True)
class Innovation(Table):
    """Innovation of a run, read."""

    KIND = "innovation"

    @property
    def unit(self) -> str:
        """Of what is sensed: V, or the sensor's own."""
        return str(self.header["columns"]["nu_x_V"]["unit"])

    @cached_property
    def nu_V(self) -> npt.NDArray[np.float64]:
        """Innovation (n, axes) in volts."""
        return self._stack("nu")

    @cached_property
    def sd_V(self) -> npt.NDArray[np.float64]:
        """Its predicted standard deviation (n, axes) in volts."""
        return self._stack("s")

    def _stack(self, prefix: str) -> npt.NDArray[np.float64]:
        return np.stack([self.columns[f"{prefix}_{axis}_V"] for axis in _AXES[: self.axes]], 1).astype(float)


def usual_sd_V(innovation: Innovation) -> npt.NDArray[np.float64] | None:
    """The predicted standard deviation (axes,) as its median over the rows; None without rows, or where it is not
    finite."""

    def of_axis(axis: int) -> list[float] | None:
        return quantiles(lambda: (piece.sd_V[:, axis] for piece in innovation.pieces()), (0.5,))

    found = [median[0] for axis in range(innovation.axes) if (median := of_axis(axis)) is not None]
    usual = np.array(found)
    return usual if len(found) == innovation.axes > 0 and np.isfinite(usual).all() else None


def steady(sd_V: npt.NDArray[np.float64], usual_V: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Whether (n,) rows count in an average: their prediction is about as sure as usual, on every axis.

    Behind a gap it is wide for a while, and what comes then is large by right: that is neither noise nor a residual.
    """
    return np.asarray((sd_V <= WIDE * usual_V).all(axis=1), np.bool_)


def stretches(innovation: Innovation, usual_V: npt.NDArray[np.float64]) -> Iterator[npt.NDArray[np.float64] | None]:
    """The innovation of steady rows (n, axes) in V, in parts that follow each other; None where a gap lies between."""
    expected: int | None = None
    for piece in innovation.pieces():
        tick, sure = piece.tick, steady(piece.sd_V, usual_V)
        nu = piece.nu_V
        cuts = np.flatnonzero((np.diff(tick) != 1) | (np.diff(sure.astype(np.int8)) != 0)) + 1
        for rows in np.split(np.arange(tick.size), cuts):
            if not rows.size or not sure[rows[0]]:
                continue
            if expected is not None and tick[rows[0]] != expected:
                yield None
            expected = int(tick[rows[-1]]) + 1
            yield nu[rows]


read_innovation = Innovation.read
