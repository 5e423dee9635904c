"""`clock.arrow`: the exchanges of time between host and board in a run on wall time (in lockstep there are none).

Host times are on the monotonic clock, received by the kernel's stamp where the link has one; `board_ns` is the board's
own clock, `tick` the board's when it answered.
"""

from dataclasses import dataclass
from functools import cached_property

from hil.records.clock_fit import ClockFit, ClockUnknownError, fit_clock
from hil.records.layout import BOARD, HOST, TICK, Column, Layout
from hil.records.table import Table

_BLOCK_ROWS = 64


def clock_layout(*, tick_rate_Hz: float) -> Layout:
    """Columns tick, t_send_ns, board_ns, t_receive_ns."""
    columns = (
        TICK,
        Column("t_send_ns", "i8", "ns", clock=HOST),
        Column("board_ns", "i8", "ns", clock=BOARD),
        Column("t_receive_ns", "i8", "ns", clock=HOST),
    )
    return Layout("clock", columns, _BLOCK_ROWS, {"tick_rate_Hz": tick_rate_Hz})


@dataclass(frozen=True)
class ClockRecord(Table):
    """The exchanges of a run, read; `tick` is the board's in each answer."""

    KIND = "clock"

    @cached_property
    def fit(self) -> ClockFit | None:
        """The board's clock by the host's; None when `unknown` says why not."""
        return self._found if isinstance(self._found, ClockFit) else None

    @property
    def unknown(self) -> str:
        """Why there is no fit, "" when there is one."""
        return self._found if isinstance(self._found, str) else ""

    @cached_property
    def _found(self) -> ClockFit | str:
        try:
            return fit_clock(*(self.columns[name] for name in ("t_send_ns", "board_ns", "t_receive_ns")))
        except ClockUnknownError as why:
            return str(why)


read_clock = ClockRecord.read
