"""Time of every kind, in every kind of source, is the same time."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.cli.import_ import import_
from hil.errors import InputError
from hil.importing.importer import import_from
from hil.importing.mapping import read_map
from hil.importing.record_time import rounded_grid, stated_grid
from hil.importing.source import ArraySource
from hil.importing.time_column import stamps_of
from hil.records.capture import read_capture
from tests.interchange.written import MAP, ROWS, X_V, bring

STEP_NS = 2_500_000
EPOCH_NS = 1_767_620_467_350_470_700
COUNT = np.arange(ROWS, dtype=np.int64)
WHOLE = EPOCH_NS + STEP_NS * COUNT
DATES = WHOLE.astype("datetime64[ns]")
MAPPED = MAP.replace('ux_V = { column = "u", unit = "V" }\n', "")


def iso(dates: np.ndarray, zone: str = "") -> list[str]:
    return [f"{date}{zone}" for date in dates]


TIMES: dict[str, tuple[Any, str]] = {
    "nanoseconds": (WHOLE, "ns"),
    "unsigned": (WHOLE.astype(np.uint64), "ns"),
    "microseconds": (1000 * (EPOCH_NS // 1_000_000) + 2500 * COUNT, "us"),
    "seconds of many digits": ([f"{value // 10**9}.{value % 10**9:09d}" for value in WHOLE.tolist()], "s"),
    "dates": (DATES, "iso"),
    "lengths of time": ((STEP_NS * COUNT).astype("timedelta64[ns]"), "iso"),
    "text": (iso(DATES), "iso"),
    "text with a zone": (iso(DATES, "Z"), "iso"),
    "text with another zone": (iso(DATES, "+02:00"), "iso"),
    "times of a day": ([str(text)[11:] for text in DATES], "iso"),
    "single precision": ((STEP_NS * 1e-9 * COUNT).astype(np.float32), "s"),
}
OF_KIND = {
    "text": set(TIMES) - {"dates", "lengths of time"},  # these are text there
    "MATLAB": {"nanoseconds", "unsigned", "microseconds", "single precision"},
    "Parquet": set(TIMES),
    "arrays": set(TIMES),
}


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, names in OF_KIND.items() for name in sorted(names)])
def test_the_same_time(tmp_path: Path, kind: str, name: str) -> None:
    values, unit = TIMES[name]
    if kind == "text" and name == "single precision":
        values = values.astype(float)
    columns = {"t": values, "x": X_V}
    capture = bring(kind, tmp_path, columns, MAPPED.replace('unit = "s"', f'unit = "{unit}"'))
    assert (capture.uniform, capture.lost, capture.tick_rate_Hz) == (True, 0, pytest.approx(400.0))
    elapsed = capture.t_s - capture.t_s[0]
    np.testing.assert_allclose(elapsed, STEP_NS * 1e-9 * COUNT, atol=1e-7 if name.startswith("single") else 1e-12)


@pytest.mark.parametrize(
    ("first_s", "rate_Hz", "told"),
    [
        (1_700_000_000, 100.0, "t_s starts at 0, which is 1700000000 s in r.csv"),
        (1_700_000_000.25, 4000.0, "t_s starts at 0, which is 1700000000.25 s in r.csv"),
        (1e8, 100.0, "t_s starts at 0, which is 100000000 s in r.csv"),
        (1_700_000_000, 0.1, None),  # a float tells its steps
        (5.0, 100.0, None),
        (0.0, 100.0, None),
    ],
)
def test_the_import_tells_which_time_the_zero_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, first_s: float, rate_Hz: float, told: str | None
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = (f"{first_s + count / rate_Hz:.6f},{np.sin(0.3 * count):.6f}" for count in range(ROWS))
    Path("r.csv").write_text("\n".join(["t_s,vx_V", *rows]), encoding="utf-8")
    import_(Path("r.csv"))
    capture = read_capture(Path("r.arrow"))
    np.testing.assert_allclose(capture.t_s - capture.t_s[0], COUNT / rate_Hz, rtol=1e-6, atol=1e-6)
    assert capture.t_s[0] == (first_s if told is None else 0.0)
    line = "".join(capsys.readouterr())
    assert ("starts at 0" in line) == (told is not None)
    assert told is None or f"\n  {told}\n" in line
    import_(Path("r.csv"), replace=True, json=True)
    assert json.loads(capsys.readouterr().out)["said"] == ([] if told is None else [told])


@pytest.mark.parametrize("name", ["dates", "nanoseconds", "text with a zone"])
def test_a_time_of_another_kind_tells_its_zero_too(tmp_path: Path, name: str) -> None:
    values, unit = TIMES[name]
    map_file = tmp_path / "m.map.toml"
    map_file.write_text(MAPPED.replace('unit = "s"', f'unit = "{unit}"'), encoding="utf-8")
    source = ArraySource({"t": values, "x": X_V}, "the arrays")
    made = import_from(source, tmp_path / "c.arrow", read_map(map_file), map_file=map_file)
    start = "1767620467.35047 s" if name == "nanoseconds" else "2026-01-05T13:41:07.350470700"
    assert made.said == (f"t_s starts at 0, which is {start} in the arrays",)


@pytest.mark.parametrize("kind", ["text", "Parquet", "arrays"])
def test_dates_need_no_map(tmp_path: Path, kind: str) -> None:
    values = iso(DATES, "Z") if kind == "text" else DATES
    capture = bring(kind, tmp_path, {"t_s": values, "vx_V": X_V}, None)
    assert capture.tick_rate_Hz == 400.0
    np.testing.assert_allclose(capture.t_s, STEP_NS * 1e-9 * COUNT, atol=1e-12)


@pytest.mark.parametrize("kind", ["text", "Parquet", "arrays"])
@pytest.mark.parametrize(
    ("values", "unit", "told"),
    [
        (iso(DATES), "s", 'set unit = "iso"'),
        (STEP_NS * COUNT, "iso", 'set unit = "s", "ms", "us" or "ns"'),
        (["yesterday 12:00"] * ROWS, "iso", "no time of ISO 8601"),
        ([*iso(DATES[:-1]), "2026-99-99T00:00:00"], "iso", "no time of ISO 8601"),
    ],
)
def test_a_time_in_another_unit_is_refused_with_the_key(
    tmp_path: Path, kind: str, values: Any, unit: str, told: str
) -> None:
    with pytest.raises(InputError, match=told) as caught:
        bring(kind, tmp_path, {"t": values, "x": X_V}, MAPPED.replace('unit = "s"', f'unit = "{unit}"'))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["text", "MATLAB", "Parquet", "arrays"])
@pytest.mark.parametrize("rounded", [np.round, np.floor, np.ceil])
def test_rounded_stamps_ask_for_their_rate_and_keep_their_gaps(tmp_path: Path, kind: str, rounded: Any) -> None:
    kept = np.delete(np.arange(100), [17, 18, 64])
    columns = {"t": rounded(5000.3 + 2.5 * kept).astype(np.int64), "x": np.sin(kept)}
    text = MAPPED.replace('unit = "s"', 'unit = "ms"')
    with pytest.raises(InputError, match=r"rounded to 0\.001 s, and 400 Hz fits them all; set sampling_rate_Hz = 400 "):
        bring(kind, tmp_path, columns, text)
    meant = bring(kind, tmp_path, columns, text, nonuniform=True)
    assert meant.prepared == ("taken as even: stamps are rounded to 0.001 s, and 400 Hz fits them all",)
    assert (meant.uniform, meant.lost, meant.gaps, meant.tick_rate_Hz) == (True, 3, 2, 400.0)
    np.testing.assert_array_equal(meant.tick, kept)
    capture = bring(kind, tmp_path, columns, "sampling_rate_Hz = 400.0\n" + text)
    assert (capture.uniform, capture.lost, capture.gaps, capture.tick_rate_Hz) == (True, 3, 2, 400.0)
    np.testing.assert_array_equal(capture.tick, kept)


def test_milliseconds_up_to_ten_seconds_are_rounded_to_a_millisecond(tmp_path: Path) -> None:
    """The last stamp, 10, has a digit more before its point, and none behind."""
    columns = {"t": np.round(np.arange(4001) / 400.0, 3), "x": np.sin(np.arange(4001))}
    with pytest.raises(InputError, match=r"rounded to 0\.001 s, and 400 Hz fits them all"):
        bring("text", tmp_path, columns, MAPPED)


@pytest.mark.parametrize("kind", ["text", "MATLAB", "Parquet", "arrays"])
def test_uneven_stamps_of_few_digits_are_told(tmp_path: Path, kind: str) -> None:
    """Steps of 2.5 ms that are off by up to 1 ms, in whole milliseconds: rounding is 40 % of a step."""
    uneven = np.floor(5000.0 + 2.5 * np.arange(100) + np.random.default_rng(7).uniform(-1.0, 1.0, 100))
    columns = {"t": uneven.astype(np.int64), "x": np.sin(np.arange(100.0))}
    capture = bring(kind, tmp_path, columns, MAPPED.replace('unit = "s"', 'unit = "ms"'), nonuniform=True)
    assert not capture.uniform
    assert capture.prepared == ("stamps are rounded to 0.001 s, 40% of a step: no interval accounts for that",)


def test_stamps_coarser_than_a_sample() -> None:
    stamps = stamps_of(np.floor(np.arange(4000) * 0.25), "ms")
    grid = rounded_grid(stamps.elapsed, stamps.digit)
    assert grid is not None
    assert grid.rate_Hz == 4000.0
    stated = stated_grid(stamps.elapsed, 4000.0, stamps.digit)
    np.testing.assert_array_equal(stated.tick, np.arange(4000))  # type: ignore[union-attr]


@pytest.mark.parametrize("digit", [1.0, 0.1, 0.01])
def test_true_jitter_is_no_rounding(digit: float) -> None:
    """Steps drawn evenly between 2 and 3 ms: a walk that no grid follows."""
    steps = np.random.default_rng(5).uniform(2.0, 3.0, 300)
    stamps = stamps_of(np.round(np.cumsum(steps) / digit) * digit, "ms")
    assert rounded_grid(stamps.elapsed, stamps.digit) is None
    for rate_Hz in (400.0, 500.0, 450.0):
        assert isinstance(stated_grid(stamps.elapsed, rate_Hz, stamps.digit), int)


def test_a_rate_that_the_stamps_do_not_have_is_refused(tmp_path: Path) -> None:
    columns = {"t": np.arange(100) / 400.0, "x": np.sin(np.arange(100))}
    with pytest.raises(InputError, match="no sample of sampling_rate_Hz = 410; on average there are 400 a second"):
        bring("text", tmp_path, columns, "sampling_rate_Hz = 410.0\n" + MAPPED)
