"""Every key of a map acts on every kind of source, or is refused there."""

from pathlib import Path

import numpy as np
import pytest

from hil.errors import InputError
from hil.importing.mapping import OF_TEXT, RecordMap
from hil.records.capture import Capture
from tests.interchange.written import COLUMNS, KINDS, MAP, SENSOR, U_V, X_V, bring

WITHOUT_TIME = MAP.replace('t_s = { column = "t", unit = "s" }\n', "")
CHANGED: dict[str, tuple[str, str]] = {
    "hold": (MAP.replace("foh", "bandlimited"), "hold"),
    "sampling_rate_Hz": ("sampling_rate_Hz = 50.0\n" + WITHOUT_TIME, "tick_rate_Hz"),
    "rows": ("rows = [10, 40]\n" + MAP, "rows"),
    "steady": ("steady = true\n" + WITHOUT_TIME, "steady"),
    "where": ('where = { sensor = "2" }\n' + MAP, "rows"),
    "missing": (f"missing = [{float(X_V[5])!r}]\n" + MAP, "rows"),
    "covariates": ("covariates = { load_kg = 2.0 }\n" + MAP, "covariates"),
    "filter": (MAP + "[filter]\nhigh_Hz = 20.0\norder = 1\n", "rows"),
    "columns": (MAP.replace('vx_V = { column = "x"', 'vx_V = { column = "u"').replace("ux_V", "temp_C").replace(
        '{ column = "u", unit = "V" }\n', '{ column = "x", unit = "K" }\n').replace(
        'vx_V = { column = "x", unit = "K" }', 'vx_V = { column = "u", unit = "V" }'), "first"),
    "segments": (MAP + "[segments]\ntrain = [0, 30]\n", "segments"),
}  # fmt: skip
TEXT = {
    "encoding": 'encoding = "utf-16"\n',
    "delimiter": 'delimiter = ";"\n',
    "quote": 'quote = "\'"\n',
    "decimal": 'decimal = ","\ndelimiter = ";"\n',
    "comment": 'comment = "0"\n',
    "skip_lines": "skip_lines = 1\n",
    "header": "header = false\n",
    "units_row": "units_row = true\n",
}


def seen(capture: Capture) -> dict[str, object]:
    """What may differ of a capture."""
    return {
        "hold": capture.hold,
        "tick_rate_Hz": capture.tick_rate_Hz,
        "rows": len(capture),
        "steady": capture.steady,
        "covariates": capture.covariates,
        "first": float(capture.sense_V[0, 0]),
        "segments": capture.segments,
    }


def test_every_key_is_tried_here() -> None:
    assert CHANGED.keys() | TEXT.keys() == RecordMap.model_fields.keys()
    assert set(TEXT) == set(OF_TEXT)


@pytest.mark.moderate
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("key", CHANGED)
def test_a_key_acts(tmp_path: Path, kind: str, key: str) -> None:
    text, shown = CHANGED[key]
    before = seen(bring(kind, tmp_path, COLUMNS))
    after = seen(bring(kind, tmp_path, COLUMNS, text))
    assert before[shown] != after[shown]


@pytest.mark.moderate
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "text"])
@pytest.mark.parametrize("key", TEXT)
def test_a_key_of_texts_is_refused_beside_what_is_none(tmp_path: Path, kind: str, key: str) -> None:
    mapping = TEXT[key] + (MAP if key != "header" else MAP.replace('"t"', "1").replace('"x"', "2").replace('"u"', "3"))
    with pytest.raises(InputError, match=r"made\.map\.toml: (\w+): acts on text only, and .* leave it out"):
        bring(kind, tmp_path, COLUMNS, mapping)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "text"])
def test_so_is_that_of_a_column(tmp_path: Path, kind: str) -> None:
    with pytest.raises(InputError, match=r"\[columns.vx_V\] thousands: acts on text only"):
        bring(kind, tmp_path, COLUMNS, MAP.replace('column = "x"', 'column = "x", thousands = ","'))


def test_rows_of_one_sensor_are_the_same_of_every_kind(tmp_path: Path) -> None:
    for kind in KINDS:
        capture = bring(kind, tmp_path, COLUMNS, 'where = { sensor = "2" }\nrows = [3, 20]\n' + MAP)
        np.testing.assert_array_equal(capture.sense_V[:, 0], X_V[SENSOR == 2][3:20])
        np.testing.assert_array_equal(capture.drive[:, 0], U_V[SENSOR == 2][3:20])
        assert capture.tick_rate_Hz == pytest.approx(50.0)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_masked_is_lost(tmp_path: Path, kind: str) -> None:
    changed = COLUMNS | {"x": np.where(np.arange(60) % 10 == 3, -999.0, X_V)}
    with pytest.raises(InputError, match=r"-999 stands for no measurement .* missing = \[-999\.0\]"):
        bring(kind, tmp_path, changed)
    capture = bring(kind, tmp_path, changed, "missing = [-999]\n" + MAP)
    assert (capture.lost, capture.gaps, capture.uniform) == (6, 6, True)
    np.testing.assert_array_equal(capture.sense_V[:, 0], X_V[capture.tick])
    assert bring(kind, tmp_path, changed, "missing = []\n" + MAP).sense_V.min() == -999.0


@pytest.mark.parametrize(("kind", "code"), [("text", "nan"), ("MATLAB", "nan"), ("Parquet", "nan"), ("arrays", "nan")])
def test_what_is_not_a_number_is_refused_or_masked(tmp_path: Path, kind: str, code: str) -> None:
    changed = COLUMNS | {"x": np.where(np.arange(60) == 20, np.nan, X_V)}
    with pytest.raises(InputError, match="nan"):
        bring(kind, tmp_path, changed)
    capture = bring(kind, tmp_path, changed, f'missing = ["{code}"]\n' + MAP)
    assert (capture.lost, len(capture)) == (1, 59)
    segments = bring(
        kind, tmp_path, changed, f'missing = ["{code}"]\n' + MAP + "[segments]\ntrain = [0, 30]\n"
    ).segments
    assert segments == {"train": (0, 29)}
