"""An exported capture comes back as it was; what a format cannot carry of it is told when it is written."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.exporting.exporter import export
from hil.importing.importer import import_record
from hil.importing.read_back import write_columns
from hil.records.capture import Capture, board_layout, import_layout, read_capture
from hil.records.stream import BlockWriter

NUMBERS = st.floats(-1e6, 1e6, allow_subnormal=False)
NAMES = st.text("abcdefgh_µ ", min_size=1, max_size=8)


@st.composite
def captures(draw: st.DrawFn) -> Any:
    """What makes a capture: layout, columns, tick numbers with gaps."""
    count = draw(st.integers(3, 40))
    axes = draw(st.sampled_from(["x", "xy"]))
    own_unit = draw(st.sampled_from([None, "px", "µstrain", "mm/s"]))
    names = ["t_s"] if draw(st.booleans()) else []
    names += [f"v{axis}_{'sensed' if own_unit else 'V'}" for axis in axes]
    if drive := draw(st.sampled_from(["", "mps2", "N", "V"])):
        names += [f"u{axis}_{drive}" for axis in axes]
    names += [name for name in ("rate_rad_s", "temp_C") if draw(st.booleans())]
    rate = draw(st.sampled_from([0.5, 10.0, 610.35, 4000.0, 1e5]))
    steps = draw(st.lists(st.integers(1, 5), min_size=count, max_size=count))
    tick = np.cumsum(steps) - steps[0]
    told: dict[str, Any] = {}
    if draw(st.booleans()):
        told["covariates"] = draw(st.dictionaries(NAMES, NUMBERS, max_size=3))
    if draw(st.booleans()):
        told |= {"noise_gain": draw(st.floats(0.01, 1.0)), "prepared": ["low-pass at 20 Hz"]}
    ends = sorted(draw(st.lists(st.integers(0, count), min_size=2, max_size=2, unique=True)))
    layout = import_layout(
        names,
        tick_rate_Hz=rate,
        uniform="t_s" not in names or draw(st.booleans()),
        hold=draw(st.sampled_from(["zoh", "foh", "bandlimited"])),
        segments={"train": (ends[0], ends[1])} if draw(st.booleans()) else {},
        steady=draw(st.booleans()),
        sense_unit=own_unit or "V",
        told=told,
    )
    values = np.random.default_rng(draw(st.integers(0, 99))).standard_normal((len(names), count))
    columns = dict(zip(names, values, strict=True))
    if "t_s" in columns:
        columns["t_s"] = tick / rate
    return layout, columns, tick


def facts(capture: Capture) -> dict[str, Any]:
    """All that a reader of a capture can ask it for."""
    return {
        "tick": capture.tick.tolist(),
        "t_s": capture.t_s.tolist(),
        "sense": capture.sense_V.tolist(),
        "drive": capture.drive.tolist() if capture.has_drive else None,
        "rate": None if capture.rate_rad_s is None else capture.rate_rad_s.tolist(),
        "temperature": None if capture.temp_C is None else capture.temp_C.tolist(),
        "drive_unit": capture.drive_unit,
        "axes": capture.axes,
        "flags": capture.flags.tolist(),
        "segments": capture.segments,
        "covariates": capture.covariates,
        "the noise gain of its filter": capture.noise_gain,
        "what was done to it at import": capture.prepared,
        "that its rows are steady states": capture.steady,
        "the hold of its drive": capture.hold,
        "the latency of its drive": capture.latency_ticks,
        "who recorded it": capture.header.get("identity"),
        "the unit of what was sensed": capture.sense_unit,
        "tick_rate_Hz": capture.tick_rate_Hz,
        "uniform": capture.uniform,
    }


def round_trip(capture: Path, to: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """What is there behind an export and an import, and what the export told to be left out."""
    file = capture.with_name(f"exported.{to}")
    written = export(capture, file, to)
    return facts(import_record(file, capture.with_name("back.arrow"))), written.left_out


@pytest.mark.parametrize("to", ["parquet", "mat"])
@given(made=captures())
@settings(max_examples=60, deadline=None)
def test_a_capture_comes_back_equal(made: Any, to: str) -> None:
    layout, columns, tick = made
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "capture.arrow"
        write_columns(path, layout, columns, tick)
        back, left_out = round_trip(path, to)
        assert back == facts(read_capture(path))
        assert left_out == ()


@given(made=captures())
@settings(max_examples=60, deadline=None)
def test_what_a_csv_leaves_out_is_told_when_it_is_written(made: Any) -> None:
    layout, columns, _ = made
    if not layout.header["uniform"]:
        return
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "capture.arrow"
        count = len(next(iter(columns.values())))
        columns = {name: np.arange(count) / layout.header["tick_rate_Hz"] if name == "t_s" else values
                   for name, values in columns.items()}  # fmt: skip
        write_columns(path, layout, columns)
        before = facts(read_capture(path))
        if before["the unit of what was sensed"] != "V":  # its column needs a map
            assert "the unit of what was sensed" in export(path, path.with_name("e.csv"), "csv").left_out
            return
        back, left_out = round_trip(path, "csv")
        changed = {name for name in before if before[name] != back[name]} - {"t_s", "tick_rate_Hz"}
        assert changed == set(left_out)
        assert back["tick_rate_Hz"] == pytest.approx(before["tick_rate_Hz"], rel=1e-9)
        assert back["t_s"] == pytest.approx(before["t_s"], rel=1e-12)


@pytest.mark.parametrize("to", ["parquet", "mat"])
def test_a_run_comes_back_with_its_board_and_flags(tmp_path: Path, to: str) -> None:
    identity = {"unique_id": 7, "firmware": 2}
    layout = board_layout(
        tick_rate_Hz=4000.0, axes=2, latency_ticks=3, sense_scale_V=7.6e-6, drive_scale=3e-4, identity=identity
    )
    rows = np.zeros(500, layout.dtype)
    rows["tick"] = np.arange(500) + 40 * (np.arange(500) >= 300)  # 40 samples were lost
    rows["vx_code"], rows["ux_code"] = np.arange(500), -np.arange(500)
    rows["flags"][17] = 2
    path = tmp_path / "capture.arrow"
    with BlockWriter(path, layout) as writer:
        writer.push(rows)
        writer.close()
    back, left_out = round_trip(path, to)
    assert back == facts(read_capture(path))
    assert (back["who recorded it"], back["the latency of its drive"], left_out) == (identity, 3, ())
    assert back["flags"][17] == 2
    assert import_record(path.with_name(f"exported.{to}"), tmp_path / "again.arrow").lost == 40
