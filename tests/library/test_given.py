"""What is given to the library: what is taken for what it is, and what is refused in one line with a remedy."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import hil
from hil.library.given import columns_of, write_capture
from hil.library.series import Series
from hil.records.capture import read_capture

STEP = 1.0 / 4000.0
TIME = np.arange(400) * STEP
MOVED = {f"v{axis}_V": np.sin(400.0 * TIME + shift) for axis, shift in (("x", 0.0), ("y", 1.0))}
ARRAYS: dict[str, Any] = {"t_s": TIME, **MOVED, "ux_mps2": np.zeros(400), "uy_mps2": np.zeros(400)}


def refusal(act: Callable[[], Any]) -> str:
    """The line with which `act` is refused."""
    with pytest.raises(hil.InputError) as told:
        act()
    assert "\n" not in str(told.value)
    return str(told.value)


def replayed(tmp_path: Path, **changed: Any) -> str:
    """The line with which a replay of arrays, some of them changed, is refused; no folder is left."""
    line = refusal(lambda: hil.replay(ARRAYS | changed, "s-slow", out=tmp_path))
    assert not list(tmp_path.iterdir())
    return line


def test_a_masked_value_is_no_measurement(tmp_path: Path) -> None:
    masked = np.ma.masked_array(MOVED["vx_V"], mask=np.arange(400) == 7)
    assert replayed(tmp_path, vx_V=masked) == "vx_V[7]: masked, which is no measurement; leave the row out"
    write_capture(ARRAYS | {"vx_V": np.ma.masked_array(MOVED["vx_V"])}, tmp_path / "c.arrow")
    np.testing.assert_array_equal(read_capture(tmp_path / "c.arrow").sense_V[:, 0], MOVED["vx_V"])


@pytest.mark.parametrize(
    ("given", "what"),
    [
        (MOVED["vx_V"] + 1j, "complex128"),
        ([str(value) for value in TIME], "text"),
        ([None] * 400, "NoneType"),
        (pd.date_range("2025-01-01", periods=400), "datetime64"),
        (MOVED["vx_V"] > 0.0, "bool"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_what_is_no_array_of_real_numbers_is_refused(tmp_path: Path, given: Any, what: str) -> None:
    line = replayed(tmp_path, vx_V=given)
    assert line.startswith(f"vx_V: no array of numbers, but of {what}")
    assert line.endswith("; give real numbers")


@pytest.mark.parametrize("unit", ["ns", "us"])
def test_dates_and_lengths_of_time_become_seconds(tmp_path: Path, unit: str) -> None:
    lengths = (np.arange(400) * 250).astype("timedelta64[us]").astype(f"timedelta64[{unit}]")
    for number, time in enumerate((lengths, np.datetime64("2026-11-28T05:24:19", unit) + lengths)):
        write_capture(ARRAYS | {"t_s": time}, tmp_path / f"{number}.arrow")
        kept = read_capture(tmp_path / f"{number}.arrow")
        assert kept.tick_rate_Hz == 4000.0
        np.testing.assert_allclose(kept.t_s, TIME, atol=1e-12)


def test_a_time_that_is_none_is_refused(tmp_path: Path) -> None:
    stamps = np.datetime64("2026-11-28", "us") + np.arange(400) * np.timedelta64(250, "us")
    stamps[3] = np.datetime64("NaT")
    assert replayed(tmp_path, t_s=stamps) == "t_s[3]: nan is no measurement; leave the row out"


def test_uneven_time_is_refused_unless_it_is_meant(tmp_path: Path) -> None:
    uneven = np.where(np.arange(400) >= 9, TIME + 0.3 * STEP, TIME)
    line = replayed(tmp_path, t_s=uneven)
    assert line == (
        "t_s[9]: step of 0.000325 s where 0.00025 s is usual; give nonuniform=True if the record is meant so"
    )
    late = np.where(np.arange(400) >= 9, TIME + 5.0, TIME)
    line = refusal(lambda: hil.replay(ARRAYS | {"t_s": late}, "s-slow", nonuniform=True, out=tmp_path))
    assert line == (
        "t_s: 20000 samples are missing, in 1 gap, more than there are; give what lies before and behind by itself"
    )
    assert not list(tmp_path.iterdir())
    write_capture(ARRAYS | {"t_s": uneven}, tmp_path / "c.arrow", nonuniform=True)
    assert not read_capture(tmp_path / "c.arrow").uniform


def test_arrays_are_called_what_they_are(tmp_path: Path) -> None:
    line = replayed(tmp_path, t_s=10.0 * TIME)
    assert line.startswith("the arrays given: recorded at 400 Hz, but [device] sample_rate_Hz = 4000")
    assert (
        refusal(lambda: hil.replay({"vx_V": TIME}, "s-slow")) == "the arrays given: no column t_s; add it, in seconds"
    )
    line = replayed(tmp_path, banana=TIME)
    assert line.startswith("the arrays given: column 'banana' is not known")
    assert "--map" not in line
    assert "column '5' is not known" in refusal(lambda: hil.replay({**ARRAYS, 5: TIME}, "s-slow"))  # type: ignore[dict-item]


@pytest.mark.parametrize("verb", [hil.replay, hil.trace, hil.compare])
def test_what_the_drive_did_is_one_of_three(tmp_path: Path, verb: Callable[..., Any]) -> None:
    line = refusal(lambda: verb(ARRAYS, "s-slow", hold="banana", out=tmp_path))
    assert line == "hold: expected zoh, foh or bandlimited, not 'banana'"
    assert not list(tmp_path.iterdir())


def test_tables_of_others_are_arrays_by_name(tmp_path: Path) -> None:
    series = Series(TIME, {name: values for name, values in ARRAYS.items() if name != "t_s"}, dict.fromkeys(ARRAYS, ""))
    frame = pd.DataFrame(ARRAYS)
    for given in (ARRAYS, series, frame, frame.set_index("t_s"), series.to_pandas(), series.to_arrow()):
        columns = columns_of(given)
        assert columns is not None
        write_capture(columns, tmp_path / "c.arrow")
        kept = read_capture(tmp_path / "c.arrow")
        np.testing.assert_array_equal(kept.t_s, TIME)
        np.testing.assert_array_equal(kept.sense_V, np.column_stack([MOVED["vx_V"], MOVED["vy_V"]]))
    assert columns_of(TIME) is None
    assert columns_of("runs/first") is None
    frame.loc[3, "vx_V"] = None
    assert refusal(lambda: hil.replay(frame, "s-slow", out=tmp_path)).startswith("vx_V[3]: nan is no measurement")


def test_what_is_no_record_path_or_bench_is_refused(tmp_path: Path) -> None:
    bench = hil.load_bench("s-slow")
    meant = "expected a Run, the path of a run folder or of a capture, or arrays by name"
    assert refusal(lambda: hil.replay(TIME, bench)) == f"record: {meant}, not ndarray"  # type: ignore[arg-type]
    assert refusal(lambda: hil.load(None)).startswith("run: expected")  # type: ignore[arg-type]
    assert refusal(lambda: hil.load_trace(5)).startswith("trace: expected")  # type: ignore[arg-type]
    assert refusal(lambda: hil.diff("a", None)).startswith("b: expected")  # type: ignore[arg-type]
    assert refusal(lambda: hil.load_bench(bench)) == (  # type: ignore[arg-type]
        "name: expected the path of a bench file or the name of an example, not Bench"
    )
    for verb in (hil.run, hil.open, lambda given: hil.replay(ARRAYS, given, out=tmp_path)):
        assert refusal(lambda verb=verb: verb({"a": 1})) == (
            "bench: expected a Bench, the path of a bench file or the name of an example, not dict"
        )
    assert refusal(lambda: hil.load_bench("x" * 5000)).endswith("file name too long; give a place that can be used")
    for name, value in (("progress", None), ("out", 5)):
        line = refusal(lambda name=name, value=value: hil.replay(ARRAYS, bench, **{name: value}))
        assert line.startswith(f"{name}: expected")
    for name, value in (("truth", 5), ("wire_log", 5), ("note", 5), ("link", 5), ("out", 5), ("progress", 5)):
        line = refusal(lambda name=name, value=value: hil.run(bench, **{"link": "inproc:s-slow", name: value}))
        assert line.startswith(f"{name}: expected")
    assert refusal(lambda: hil.compare(ARRAYS, bench, trace=5)).startswith("trace: expected")  # type: ignore[arg-type]
    for name, value in (("fraction", "a"), ("hold_out", 5), ("hold_out", [5])):
        line = refusal(lambda name=name, value=value: hil.trace(ARRAYS, bench, **{name: value}))
        assert line.startswith(f"{name}: expected")
    assert refusal(lambda: hil.sweep("s-slow-noise", workers="2")).startswith("workers: expected")  # type: ignore[arg-type]
    line = refusal(lambda: hil.replay(ARRAYS, bench, backend="banana", out=tmp_path))  # type: ignore[arg-type]
    assert line.startswith("the arrays given: no backend 'banana'; known: c")
    assert not list(tmp_path.iterdir())


@pytest.mark.moderate
def test_a_run_is_taken_wherever_a_run_is_meant(whole_run: Path, tmp_path: Path) -> None:
    run = hil.load(whole_run)
    assert hil.load(run).path == run.path
    assert refusal(lambda: hil.score(run, None)) == "truth: expected a path, not None"  # type: ignore[arg-type]
    assert refusal(lambda: hil.export(run, 5)) == "target: expected a path, not int"  # type: ignore[arg-type]
    assert refusal(lambda: hil.export(run, tmp_path / "y")).endswith(
        "y: its name ends with no format; known are csv, parquet, mat, mcap, or give to="
    )
    assert refusal(lambda: hil.export(run, tmp_path / "y.csv", what="foo")).startswith("what: foo is not known")
    assert refusal(lambda: hil.export(run, tmp_path / "y", to="foo")).startswith("to: foo is no known format")


def test_a_share_that_is_none_is_refused_by_its_argument(tmp_path: Path) -> None:
    assert refusal(lambda: hil.trace(ARRAYS, "s-slow", fraction=2, out=tmp_path)).startswith("fraction: 2 is no share")
