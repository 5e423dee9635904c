"""A board that has run before goes on counting its ticks: how far a run is, is told from its own first sample."""

import json

import numpy as np

from hil.cli.top import rows
from hil.service.telemetry.hub import Now


class _Newest:
    """Rows that came with the last look."""

    passed_over = 0

    def __init__(self, ticks: np.ndarray) -> None:
        self.new = np.zeros(ticks.size, [("tick", "i8"), ("flags", "u1")])
        self.new["tick"] = ticks
        self.kept = self
        self.layout = type(
            "Layout", (), {"kind": "capture", "columns": (), "header": {"identity": {"latency_ticks": 1}}}
        )

    def newest(self, count: int) -> np.ndarray:
        return self.new[-count:]


class _Tracks(dict):
    rate_Hz = 4000.0


def test_a_second_run_begins_at_zero() -> None:
    now = Now()
    before = 4735 * 4000
    for first in (0, 8000):
        tracks = _Tracks(capture=_Newest(np.arange(before + first, before + first + 8000)))
        now.look(tracks)
    told = now.run(tracks)
    assert told is not None
    assert told["elapsed_s"] == 4.0
    assert told["t_s"] == (before + 15999) / 4000.0
    state = {
        "now": told, "health": {}, "state": "RUNNING", "reason": "", "link": "l", "words": "", "lease": None,
        "run": "r", "stage": "run", "done": 1, "total": 10, "duration_s": 40.0,
    }  # fmt: skip
    assert ("time", "4.00 s of 40 s") in rows(json.loads(json.dumps(state)))
