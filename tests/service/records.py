"""Records as a board leaves them, made at will: of any length, with gaps."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from hil.records.capture import board_layout
from hil.records.layout import Layout
from hil.records.pyramid import Pyramid
from hil.records.stream import BlockWriter

RATE_HZ = 100_000.0
SCALE_V, SCALE_MPS2 = 1e-4, 2e-3


def layout() -> Layout:
    """A board of two axes at 100 kS/s."""
    return board_layout(
        tick_rate_Hz=RATE_HZ, axes=2, latency_ticks=1, sense_scale_V=SCALE_V, drive_scale=SCALE_MPS2,
        identity={"unique_id": 0xABCD},
    )  # fmt: skip


def rows_at(tick: npt.NDArray[np.int64]) -> npt.NDArray[np.void]:
    """Rows whose every value follows from its tick: vx counts up and down, vy is a hash, ux and uy are near a limit."""
    rows = np.zeros(tick.size, layout().dtype)
    rows["tick"] = tick
    rows["vx_code"] = np.abs(tick % 20_000 - 10_000)
    rows["vy_code"] = (tick * 2_654_435_761 % (1 << 32)) >> 16
    rows["ux_code"] = -(tick % 7)
    rows["uy_code"] = 40 + tick // 1000 % 3
    return rows


def write(folder: Path, ticks: npt.NDArray[np.int64], *, pyramid: bool, ended: bool = True, piece: int = 5_000) -> Path:
    """`capture.arrow` of these ticks in `folder`, with its pyramid written along, as the recorder does."""
    path = folder / "capture.arrow"
    folder.mkdir(parents=True, exist_ok=True)
    writer = BlockWriter(path, layout())
    along = Pyramid(path, layout()) if pyramid else None
    for start in range(0, ticks.size, piece):
        rows = rows_at(ticks[start : start + piece])
        writer.push(rows)
        if along is not None:
            along.push(rows)
    for one in (writer, along):
        if one is not None:
            one.close() if ended else one.abandon()
    return path
