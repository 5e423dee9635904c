"""Time of every kind, in every kind of source, is the same time."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.errors import InputError
from hil.interchange.rounded_time import rounded_grid, stated_grid
from hil.interchange.time_column import stamps_of
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
    assert not meant.uniform
    assert "400 Hz fits them all: set sampling_rate_Hz = 400 " in meant.prepared[0]
    capture = bring(kind, tmp_path, columns, "sampling_rate_Hz = 400.0\n" + text)
    assert (capture.uniform, capture.lost, capture.gaps, capture.tick_rate_Hz) == (True, 3, 2, 400.0)
    np.testing.assert_array_equal(capture.tick, kept)


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
