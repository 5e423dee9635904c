"""What the page is told of a run that lasts, by the newest rows of its tracks."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from hil.records.trims import trims_layout
from hil.service.telemetry.now import Now


class Tracks(dict[str, Any]):
    """Tracks of rows that are there already."""

    rate_Hz = 100.0


def track(layout: Any, rows: Any) -> SimpleNamespace:
    return SimpleNamespace(layout=layout, new=rows, kept=SimpleNamespace(newest=lambda count: rows[-count:]))


def test_the_voltages_of_trim_outputs_are_told_beside_their_limits() -> None:
    layout = trims_layout([{"name": "x", "most_V": 10.0}, {"name": "q+", "most_V": -5.0}], tick_rate_Hz=100.0)
    rows = np.zeros(2, layout.dtype)
    rows["x_V"], rows["q+_V"] = (0.5, 1.5), (0.0, -2.5)
    capture = track(
        SimpleNamespace(columns=(), header={"identity": {"latency_ticks": 1}}),
        np.array([(0, 0), (1, 0)], [("tick", "<i8"), ("flags", "<u2")]),
    )
    tracks, now = Tracks(capture=capture, trims=track(layout, rows)), Now()
    now.look(tracks)  # type: ignore[arg-type]
    told = now.run(tracks)  # type: ignore[arg-type]
    assert told is not None
    assert told["trims"] == {"x": {"volts": 1.5, "most_V": 10.0}, "q+": {"volts": -2.5, "most_V": -5.0}}
