"""Values of a map that can mean nothing are refused with the key; numbers that a conversion breaks, with their row."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.errors import InputError
from tests.interchange.written import COLUMNS, KINDS, MAP, ROWS, T_S, U_V, X_V, bring

TWO = """\
hold = "foh"
[columns]
t_s = { column = "t", unit = "s" }
vx = { column = "x", unit = "px" }
vy = { column = "u", unit = "mm" }
"""


def refused(place: Path, mapping: str, kind: str = "text", columns: dict[str, Any] = COLUMNS) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError) as caught:
            bring(kind, place, columns, mapping)
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_two_axes_in_two_units(tmp_path: Path) -> None:
    line = refused(tmp_path, TWO)
    assert "[columns.vy] unit: 'mm', but vx is in 'px'; give both axes in one unit" in line
    assert bring("text", tmp_path, COLUMNS, TWO.replace('"mm"', '"px"')).sense_unit == "px"


def test_two_spellings_of_micro_are_one_unit(tmp_path: Path) -> None:
    mapping = TWO.replace('"px"', '"\N{MICRO SIGN}strain"').replace('"mm"', '"\N{GREEK SMALL LETTER MU}strain"')
    assert bring("text", tmp_path, COLUMNS, mapping).sense_unit == "\N{MICRO SIGN}strain"


@pytest.mark.parametrize("micro", ["u", "\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"])
def test_micro_in_every_spelling(tmp_path: Path, micro: str) -> None:
    capture = bring(
        "text",
        tmp_path,
        COLUMNS,
        MAP.replace('vx_V = { column = "x", unit = "V"', f'vx_V = {{ column = "x", unit = "{micro}V"'),
    )
    np.testing.assert_allclose(capture.sense_V[:, 0], 1e-6 * X_V)


@pytest.mark.parametrize("kind", KINDS)
def test_a_conversion_beyond_all_numbers(tmp_path: Path, kind: str) -> None:
    large = MAP.replace('column = "x", unit = "V"', 'column = "x", unit = "V", scale = 1e308, offset = 1.7e308')
    line = refused(tmp_path, large, kind)
    row = int(np.argmax(np.finfo(float).max - 1.7e308 < 1e308 * X_V))
    place = {"text": f"csv:{row + 2}:", "MATLAB": f"entry {row + 1}:", "Parquet": f"row {row}:", "arrays": f"[{row}]:"}
    assert place[kind] in line
    assert "no finite number in V; correct scale, offset or unit" in line


def test_a_level_beyond_all_numbers(tmp_path: Path) -> None:
    line = refused(tmp_path, MAP.replace('column = "x", unit = "V"', 'column = "x", unit = "dBV", scale = 1e6'))
    assert "no finite number in dBV" in line


def test_a_time_beyond_all_numbers(tmp_path: Path) -> None:
    line = refused(tmp_path, MAP.replace('unit = "s"', 'unit = "week", scale = 1e308'))
    assert "made.csv:2: column t (t_s): no finite number in week; correct scale, offset or unit" in line


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('unit = "V" }', 'unit = "V", scale = 0 }', "scale: 0 makes every value the same; give another"),
        ('unit = "s" }', 'unit = "s", scale = 0.0 }', "scale: 0 makes every value the same; give another"),
        ('column = "x"', "column = 0", "column: 0 is no position; positions count from 1"),
        ('column = "x"', "column = -1", "column: -1 is no position; positions count from 1"),
        ('column = "x"', "column = 1.5", "column: expected a name in quotes, or a position from 1, not 1.5"),
        ('column = "x"', "column = true", "column: expected a name in quotes, or a position from 1, not true"),
        ("hold", "sampling_rate_Hz = 1e300\nhold", "1e+300 should be less than or equal to"),
        ("hold", "sampling_rate_Hz = 1e-300\nhold", "1e-300 should be greater than or equal to"),
        ("[columns]", "[filter]\nlow_Hz = 1e-9\n[columns]", "[filter] low_Hz: 1e-09 Hz is below"),
        ("[columns]", "[filter]\nhigh_Hz = 1e-9\n[columns]", "[filter] high_Hz: 1e-09 Hz is below"),
    ],
)  # fmt: skip
def test_values_that_mean_nothing(tmp_path: Path, old: str, new: str, told: str) -> None:
    line = refused(tmp_path, MAP.replace(old, new, 1))
    assert "made.map.toml" in line
    assert told in line


def test_stamps_of_a_rate_that_nothing_has(tmp_path: Path) -> None:
    line = refused(tmp_path, MAP.replace('unit = "s"', 'unit = "ns", scale = 1e-6'))
    assert "Hz; check the unit of t_s" in line


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("listed", ['["OVLD"]', "[9.9e37]"])
@pytest.mark.parametrize("code", [-9.9e37, -999.0])
def test_a_list_of_codes_does_not_excuse_the_others(tmp_path: Path, kind: str, listed: str, code: float) -> None:
    x = X_V.copy()
    x[[5, 9]] = [code, 9.9e37 if "9" in listed else code]
    line = refused(tmp_path, f"missing = {listed}\n" + MAP, kind, {**COLUMNS, "x": x})
    assert f"{code:.12g} stands for no measurement where instruments write; add {code!r} to missing" in line
    bring(kind, tmp_path, {**COLUMNS, "x": x}, "missing = []\n" + MAP)


def test_a_row_of_units_that_holds_numbers(tmp_path: Path) -> None:
    assert "made.csv:2: units_row: column t (t_s) reads '0.0', a number" in refused(
        tmp_path, "units_row = true\n" + MAP
    )
    with_units = {
        name: np.array([unit, *values], dtype=object)
        for (name, values), unit in zip(COLUMNS.items(), ("s", "1", "V", "7"), strict=True)
    }
    assert len(bring("text", tmp_path, with_units, "units_row = true\n" + MAP)) == ROWS


@pytest.mark.parametrize("kind", KINDS)
def test_where_is_told_by_its_name(tmp_path: Path, kind: str) -> None:
    assert "where sensor reads '7'" in refused(tmp_path, 'where = { sensor = "7" }\n' + MAP, kind)


def test_a_map_with_a_byte_order_mark(tmp_path: Path) -> None:
    assert len(bring("text", tmp_path, COLUMNS, "\N{ZERO WIDTH NO-BREAK SPACE}" + MAP)) == ROWS


def test_exponents_of_fortran(tmp_path: Path) -> None:
    written = {
        name: np.array([f"{value:.12E}".replace("E", "D") for value in values], dtype=object)
        for name, values in (("t", T_S), ("x", X_V), ("u", U_V))
    }
    capture = bring("text", tmp_path, written)
    np.testing.assert_allclose(capture.t_s, T_S, atol=1e-15)
    np.testing.assert_array_equal(capture.sense_V[:, 0], X_V)
    assert "'1D3' is not a number" in refused(
        tmp_path, MAP, columns={**COLUMNS, "x": np.array(["1D3"] * ROWS, dtype=object)}
    )


def test_thousands_of_switzerland(tmp_path: Path) -> None:
    mark = "\N{RIGHT SINGLE QUOTATION MARK}"
    x = np.array([f"{1000 + row:,}.5".replace(",", mark) for row in range(ROWS)], dtype=object)
    line = refused(tmp_path, MAP, columns={**COLUMNS, "x": x})
    assert f'set thousands = "{mark}" of this column' in line
    given = MAP.replace('column = "x"', f'column = "x", thousands = "{mark}"')
    np.testing.assert_array_equal(
        bring("text", tmp_path, {**COLUMNS, "x": x}, given).sense_V[:, 0], 1000.5 + np.arange(ROWS)
    )
