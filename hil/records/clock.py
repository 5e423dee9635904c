"""`clock.arrow`: the exchanges of time between host and board in a run on wall time (in lockstep there are none).

Host times are on the monotonic clock, received by the kernel's stamp where the link has one; `board_ns` is the board's
own clock, `tick` the board's when it answered.

The relation of two clocks from exchanges of their times: offset and skew, and how well they are known.

The host notes when it asks (s) and when the answer arrives (r); the board puts its own time (b) into the answer. The
board read its clock somewhere between s and r, so that half the round trip bounds what an exchange by itself can be
wrong by, and nothing on either side can tell more: where in between is the asymmetry of the link.

What waited in a queue took longer. So of each part of the record only the exchange with the least delay is used (the
clock filter of NTP: D. Mills et al., RFC 5905, 2010, section 10; parts rather than a running window, with about as many
as the root of the number of exchanges: V. Paxson, "On calibrating measurements of packet transit times", SIGMETRICS
1998), weighted by how much longer than the shortest of all it took (D. Veitch, J. Ridoux & S. Korada, "Robust
synchronization of absolute and difference clocks over networks", IEEE/ACM Trans. Networking 17(2), 2009); through these
goes a line.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hil.numbers import SD_95
from hil.records.layout import BOARD, HOST, TICK, Column, Layout
from hil.records.table import Table

Nanoseconds = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

MIN_EXCHANGES = 8
MIN_PARTS = 3
"""Parts of the record with an exchange in them: a line through fewer says nothing of its own error."""
_MAX_PARTS = 200
_MAX_CHANGE = 1e-4
"""By which an oscillator may change its rate between neighbouring parts of a record; what is more was no oscillator."""
_ALIKE = 0.1
"""Share of the shortest round trip that is taken for the standard deviation of an exchange as short as that."""
_LEVEL = 0.975


class ClockUnknownError(ValueError):
    """The exchanges do not give a relation; one line says why."""


@dataclass(frozen=True)
class ClockFit:
    """At host time h (ns, monotonic) the board's clock shows h + offset_ns + skew · (h − at_host_ns).

    `skew` is how much faster the board's clock runs than the host's. `offset_ci_ns` and `skew_ci` are half widths of
    95 % intervals: an exchange as short as the shortest is taken to be off by a tenth of its round trip, a longer one
    by half of what it took longer as well, and all by more if they scatter more about the line. A constant asymmetry
    of the link, which no scatter shows, moves the offset by up to half of `round_trip_ns`, the shortest, and one that
    changes in the worst possible way the skew by up to `skew_bound`. `exchanges` there were, `used` of them.
    """

    at_host_ns: int
    offset_ns: int
    offset_ci_ns: float
    skew: float
    skew_ci: float
    skew_bound: float
    round_trip_ns: float
    exchanges: int
    used: int

    @property
    def offset_uncertainty_ns(self) -> float:
        """Half the shortest round trip and the scatter together."""
        return 0.5 * self.round_trip_ns + self.offset_ci_ns

    def host_ns(self, board_ns: Nanoseconds) -> Floats:
        """The host's time when the board's clock showed `board_ns`, less `at_host_ns`."""
        return np.asarray((board_ns - np.int64(self.at_host_ns + self.offset_ns)) / (1.0 + self.skew))


def fit_clock(sent_ns: Nanoseconds, board_ns: Nanoseconds, received_ns: Nanoseconds) -> ClockFit:
    """Offset and skew of a board's clock from exchanges (n,): host time sent, board time, host time received.

    Raises:
        ClockUnknownError: too few exchanges, or too close together; or the board's clock jumped.
    """
    usable = np.flatnonzero(received_ns >= sent_ns)  # stamps of a clock that was set meanwhile may be anything
    order = usable[np.argsort(sent_ns[usable], kind="stable")]
    sent, board, received = (times[order] for times in (sent_ns, board_ns, received_ns))
    if sent.size < MIN_EXCHANGES:
        raise ClockUnknownError(f"{sent.size} exchanges of time are too few; {MIN_EXCHANGES} are needed")
    # Whole numbers up to here: a double resolves a fraction of a microsecond of a clock that has run for years.
    start_ns, apart_ns = sent[0], board[0] - sent[0]
    host = 0.5 * ((sent - start_ns) + (received - start_ns))
    trip = (received - sent).astype(float)
    offset = (board - start_ns - apart_ns) - host
    best = _shortest(host, trip)
    if best.size < MIN_PARTS:
        raise ClockUnknownError(f"{sent.size} exchanges of time, but all at once; a longer run is needed")
    x, y, delay = host[best], offset[best], trip[best]
    _require_steady(x, y, delay)
    excess = 0.5 * (delay - trip.min())
    weight = 1.0 / (max(_ALIKE * float(trip.min()), 1.0) ** 2 + excess**2)
    centre = float(np.average(x, weights=weight))
    height = float(np.average(y, weights=weight))
    moment = float(np.sum(weight * (x - centre) ** 2))
    share = weight * (x - centre) / moment  # of each exchange in the slope
    skew = float(np.sum(share * y))
    left = y - height - skew * (x - centre)
    scatter = math.sqrt(float(np.sum(weight * left**2)) / (best.size - 2))  # over what the weights take for granted
    width = max(SD_95, student(best.size - 2) * scatter)
    return ClockFit(
        at_host_ns=int(start_ns) + round(centre),
        offset_ns=int(apart_ns) + round(height),
        offset_ci_ns=width / math.sqrt(float(weight.sum())),
        skew=skew,
        skew_ci=width / math.sqrt(moment),
        skew_bound=float(np.sum(np.abs(share) * delay)) / 2.0,
        round_trip_ns=float(trip.min()),
        exchanges=int(sent.size),
        used=int(best.size),
    )


def _shortest(host: Floats, trip: Floats) -> npt.NDArray[np.intp]:
    """Of each part of the record, all equally long, the exchange with the shortest round trip."""
    parts = min(max(round(math.sqrt(host.size)), MIN_PARTS), _MAX_PARTS)
    length = max((float(host.max()) - float(host.min())) / parts, 1.0)
    part = np.minimum((host - host.min()) // length, parts - 1)
    order = np.lexsort((trip, part))
    return order[np.unique(part[order], return_index=True)[1]]


def _require_steady(x: Floats, y: Floats, delay: Floats) -> None:
    """ClockUnknownError if neighbours are further apart than their round trips and any oscillator explain."""
    i, j = np.triu_indices(x.size, 1)
    skew = float(np.median((y[j] - y[i]) / (x[j] - x[i])))  # Theil and Sen's slope, which a jump cannot carry away
    step = np.diff(y) - skew * np.diff(x)
    beyond = np.abs(step) - 0.5 * (delay[1:] + delay[:-1]) - _MAX_CHANGE * np.diff(x)
    worst = int(np.argmax(beyond))
    if beyond[worst] > 0.0:
        raise ClockUnknownError(
            f"the board's clock jumped by {1e-9 * step[worst]:.3g} s, {1e-9 * x[worst + 1]:.3g} s into the run; "
            "did it restart?"
        )


def student(freedom: int, level: float = _LEVEL) -> float:
    """Quantile of Student's distribution, by default for a 95 % interval."""
    from scipy.special import stdtrit  # loads slowly: only where there is something to fit

    return float(stdtrit(freedom, level))


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
