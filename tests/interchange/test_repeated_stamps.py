"""A stamp written twice is named; a rate is offered and taken only where it is that of every stamp."""

from pathlib import Path

import numpy as np
import pytest

from hil.errors import InputError
from hil.importing.record_time import rounded_grid, stated_grid
from tests.interchange.written import KINDS, MAP, bring

MAPPED = MAP.replace('ux_V = { column = "u", unit = "V" }\n', "")
ROWS = 601
TWICE = np.insert(np.arange(600), 300, 299) / 1000.0
X = np.sin(np.arange(ROWS) / 9.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("nonuniform", [False, True])
def test_a_row_written_twice_is_named(tmp_path: Path, kind: str, nonuniform: bool) -> None:
    with pytest.raises(InputError, match=r"0\.299 s is the stamp of the row before as well; remove the row") as caught:
        bring(kind, tmp_path, {"t": TWICE, "x": X}, MAPPED, nonuniform=nonuniform)
    place = {"text": "made.csv:302:", "MATLAB": "entry 301:", "Parquet": "row 300:", "arrays": "t_s[300]:"}[kind]
    assert place in str(caught.value)
    assert "sampling_rate_Hz" not in str(caught.value)


@pytest.mark.parametrize("step_ms", [1.0, 2.0, 2.5, 10.0])
def test_a_stated_rate_does_not_take_a_row_written_twice(tmp_path: Path, step_ms: float) -> None:
    stamps = np.round(np.insert(np.arange(600), 300, 299) * step_ms) / 1000.0
    with pytest.raises(InputError, match=r"made\.csv:302: column t_s: the stamp is no sample of sampling_rate_Hz"):
        bring("text", tmp_path, {"t": stamps, "x": X}, f"sampling_rate_Hz = {1000 / step_ms}\n" + MAPPED)


@pytest.mark.parametrize("rate_Hz", [1000.0, 900.0, 400.0])
def test_a_stated_rate_keeps_a_sample_that_is_missing(tmp_path: Path, rate_Hz: float) -> None:
    kept = np.delete(np.arange(602), 300)
    stamps = np.floor(kept * 1000.0 / rate_Hz + 1e-9) / 1000.0
    capture = bring("text", tmp_path, {"t": stamps, "x": X}, f"sampling_rate_Hz = {rate_Hz}\n" + MAPPED)
    np.testing.assert_array_equal(capture.tick, kept)


def test_two_rows_written_twice_are_no_rate() -> None:
    stamps = np.sort(np.concatenate([np.arange(600), [199, 399]])) / 1000.0
    assert rounded_grid(stamps, 1e-3) is None


@pytest.mark.parametrize("rate_Hz", [1250.0, 1500.0, 4000.0])
def test_rates_above_the_resolution_have_stamps_twice(rate_Hz: float) -> None:
    stamps = np.floor(np.arange(400) * 1000.0 / rate_Hz + 1e-9) / 1000.0
    grid = rounded_grid(stamps, 1e-3)
    assert grid is not None
    assert grid.rate_Hz == rate_Hz
    np.testing.assert_array_equal(stated_grid(stamps, rate_Hz, 1e-3).tick, np.arange(400))  # type: ignore[union-attr]


def test_days_of_eight_decimals_are_no_gaps() -> None:
    """A spreadsheet's day of 8 decimals is 0.864 ms; a record of 1 kHz has no gap in it."""
    grid = rounded_grid(np.round(np.arange(600) / 0.864) * 864e-6, 864e-6)
    assert grid is not None
    assert grid.rate_Hz == 1000.0
    np.testing.assert_array_equal(grid.tick, np.arange(600))


def test_an_earlier_stamp_is_not_one_written_twice(tmp_path: Path) -> None:
    stamps = np.arange(ROWS) / 1000.0
    stamps[300:] -= 0.1
    with pytest.raises(InputError, match=r"made\.csv:302: column t_s: 0\.2 s is not later than 0\.299 s"):
        bring("text", tmp_path, {"t": stamps, "x": X}, MAPPED)


def test_stamps_that_all_repeat_are_no_time(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="600 rows in all repeat one; leave out t_s and set sampling_rate_Hz"):
        bring("text", tmp_path, {"t": np.zeros(ROWS), "x": X}, MAPPED)
