"""The live count of late answers is that of the record: held against `hil.records.summary` on the same rows."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.records.summary import count_answers
from hil.records.timing import Timing, ledger_layout, timing_layout
from hil.service.telemetry.deadlines import Deadlines
from hil.wire.messages import SenseFlags

TICKS, LATENCY, BLOCK = 4000, 2, 20


class Track:
    """A track that is fed piece by piece."""

    def __init__(self, header: dict[str, Any], rows: Any) -> None:
        self.layout = SimpleNamespace(header=header)
        self.new = rows[:0]
        self._all, self._seen = rows, 0
        self.kept = SimpleNamespace(newest=lambda n: self._all[max(self._seen - n, 0) : self._seen])

    def upto(self, tick: int) -> None:
        end = int(np.searchsorted(self._all["tick"], tick, "right"))
        self.new, self._seen = self._all[self._seen : end], end


def table(**columns: Any) -> Any:
    rows = np.empty(len(columns["tick"]), [(name, np.asarray(values).dtype) for name, values in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    return rows


def live(capture: Track, timing: Track) -> Deadlines:
    found = Deadlines()
    for tick in range(0, TICKS + 200, 170):
        capture.upto(tick)
        timing.upto(tick - 30)  # what the loop says of an answer comes behind its sample
        found.look(capture, timing)  # type: ignore[arg-type]
    return found


@pytest.mark.parametrize("seed", range(5))
def test_force_mode(seed: int) -> None:
    random = np.random.default_rng(seed)
    tick = np.arange(TICKS)
    answered = np.sort(random.choice(tick, 3500, replace=False))
    # Every sample without an answer has its interval held, and of the answered ones some came late.
    missed = np.union1d(np.setdiff1d(tick, answered), random.choice(answered, 300, replace=False))
    flags = np.where(np.isin(tick - LATENCY - 1, missed), int(SenseFlags.HELD), 0).astype(np.uint8)
    header = timing_layout(tick_rate_Hz=4000.0, deadline_us=100.0).header
    sent = {"t_receive_ns": 1000 * answered, "t_estimate_ns": 1000 * answered, "t_send_ns": 1000 * answered + 5}
    counted = count_answers([(tick, flags)], Timing({"tick": answered, **sent}, header, True), LATENCY, board_late=None)
    assert counted is not None
    found = live(
        Track({"identity": {"latency_ticks": LATENCY}}, table(tick=tick, flags=flags)),
        Track(dict(header), table(tick=answered, **sent)),
    )
    assert found.late == counted.late > 200
    assert found.in_time == pytest.approx(1.0 - np.count_nonzero(flags) / TICKS)


@pytest.mark.parametrize("seed", range(5))
def test_gain_mode(seed: int) -> None:
    random = np.random.default_rng(seed)
    ends = np.arange(BLOCK - 1, TICKS, BLOCK)[:-1]
    answered = np.sort(random.choice(ends, 150, replace=False))
    used = answered + BLOCK
    applied = np.where(random.random(150) < 0.3, used + 7, used)
    tick, flags = np.arange(TICKS), np.zeros(TICKS, np.uint8)
    header = ledger_layout(tick_rate_Hz=4000.0, block=BLOCK, deadline_us=100.0).header
    sent = {"t_receive_ns": 1000 * answered, "t_estimate_ns": 1000 * answered, "t_send_ns": 1000 * answered + 5}
    columns = {"tick": answered, **sent, "applied_tick": applied}
    counted = count_answers([(tick, flags)], Timing(columns, header, True), LATENCY, board_late=None)
    assert counted is not None
    found = live(
        Track({"identity": {"latency_ticks": LATENCY}}, table(tick=tick, flags=flags)),
        Track(dict(header), table(**columns)),
    )
    assert found.late == counted.late > 200
    assert found.in_time == pytest.approx(counted.in_time / TICKS, abs=0.02)
