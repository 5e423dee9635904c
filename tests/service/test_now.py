"""What the page is told of a run that lasts, by the newest rows of its tracks."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from hil.cli.top import rows
from hil.records.capture import trims_layout
from hil.records.estimates import estimates_layout
from hil.service.telemetry.hub import Now


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


def test_an_uncertainty_that_a_plug_in_does_not_give_is_told_as_not_given() -> None:
    """A constant with deviation 0 is the declared one (docs/reference/plug-ins.md)."""
    layout = estimates_layout(["rate_rad_s", "kxx_per_s2", "dxx_per_s"], tick_rate_Hz=100.0, every=1, angle=True)
    newest = np.zeros(1, layout.dtype)
    newest["rate_rad_s"], newest["kxx_per_s2"], newest["dxx_per_s"], newest["angle_rad"] = 0.5, 1e6, 0.7, 2.0
    for name in ("sd_rate_rad_s", "sd_kxx_per_s2", "angle_u_rad", "angle_sd_rad"):
        newest[name] = np.nan
    capture = track(
        SimpleNamespace(columns=(), header={"identity": {"latency_ticks": 1}}),
        np.array([(0, 0)], [("tick", "<i8"), ("flags", "<u2")]),
    )
    tracks, now = Tracks(capture=capture, estimates=track(layout, newest)), Now()
    now.look(tracks)  # type: ignore[arg-type]
    told = now.run(tracks)  # type: ignore[arg-type]
    assert told is not None
    assert told["estimates"] == {
        "rate_rad_s": [0.5, None, "rad/s"],
        "kxx_per_s2": [1e6, None, "1/s²"],
        "dxx_per_s": [0.7, None, "1/s"],
    }
    assert (told["angle_u_rad"], told["angle_expanded_rad"], told["rate_u"]) == (None, None, None)
    state = {
        "state": "RUNNING", "reason": "", "link": "l", "words": "", "lease": None, "run": "r", "stage": "run",
        "total": 0, "duration_s": 1.0, "now": told, "health": {},
    }  # fmt: skip
    shown = dict(rows(state))
    assert shown["angle"] == "2 rad, uncertainty not given"
    assert shown["rate"] == "0.5 rad/s, uncertainty not given"
