"""Texts, Parquet and MATLAB files with an oddity each: sound ones come in as an independent reader has them, all others
are one line that says what to do."""

import gzip
import io
from collections.abc import Iterable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from hil.errors import InputError
from hil.importing.importer import import_file
from hil.importing.request import ImportRequest

T = np.arange(200) / 1000.0
X, Y = np.round(np.sin(200.0 * T), 6), np.round(np.cos(200.0 * T), 6)
ROWS = list(zip(T, X, Y, strict=True))
AT_50 = f"{X[50]:.6f}"
MAPPED = 'hold = "zoh"\n[columns]\nt_s = { column = "t", unit = "s" }\n' + "".join(
    f'v{axis}_V = {{ column = "{axis}", unit = "V" }}\n' for axis in "xy"
)


def text(
    head: str = "t_s,vx_V,vy_V", rows: Iterable[tuple[float, ...]] = ROWS, *, between: str = ",", end: str = "\n"
) -> str:
    lines = [head, *(",".join(f"{value:.6f}" for value in row) for row in rows)]
    return "".join(line.replace(",", between) + end for line in lines)


def parquet(**columns: Any) -> bytes:
    file = io.BytesIO()
    pq.write_table(pa.table({"t_s": T, "vx_V": X, "vy_V": Y} | columns), file)
    return file.getvalue()


def matlab(**given: Any) -> bytes:
    file = io.BytesIO()
    options = {key: given.pop(key) for key in ("format", "do_compression", "oned_as") if key in given}
    savemat(file, {"t": T, "x": X, "y": Y} | given, **options)
    return file.getvalue()


GERMAN = MAPPED.replace("hold", 'delimiter = ";"\ndecimal = ","\nhold')
SOUND: dict[str, tuple[str | bytes, str | None, str]] = {
    "byte order mark": (b"\xef\xbb\xbf" + text().encode(), None, "csv"),
    "UTF-16": (text().encode("utf-16"), None, "csv"),
    "decimal commas": (text("t,x,y", between=";").replace(".", ","), GERMAN, "csv"),
    "mixed line ends": (text(rows=ROWS[:90]) + text("", ROWS[90:], end="\r\n").lstrip(), None, "csv"),
    "ends of an old Mac": (text(end="\r"), None, "csv"),
    "no last end": (text().rstrip(), None, "csv"),
    "blank lines": (text().replace("\n", "\n\n"), None, "csv"),
    "an empty column": (text("t_s,vx_V,vy_V,", end=",\n").replace(",,\n", ",\n", 1), None, "csv"),
    "gzipped, named csv": (gzip.compress(text().encode()), None, "csv"),
    "quoted numbers": ("".join(f'"{line}"\n' for line in text(between='","').splitlines()), None, "csv"),
    "a row of units": (text().replace("\n", "\ns,V,V\n", 1), 'units_row = true\nhold = "zoh"\n', "csv"),
    "decimals of Parquet": (parquet(vx_V=pa.array([Decimal(f"{value:.6f}") for value in X])), None, "parquet"),
    "a dictionary of Parquet": (parquet(vx_V=pa.array(X).dictionary_encode()), None, "parquet"),
    "row vectors": (matlab(oned_as="row"), MAPPED, "mat"),
    "MATLAB 4": (matlab(format="4"), MAPPED, "mat"),
    "compressed MATLAB": (matlab(do_compression=True), MAPPED, "mat"),
}  # fmt: skip
REFUSED: dict[str, tuple[str | bytes, str | None, str, str]] = {
    "a stamp twice": (text(rows=[*ROWS[:100], ROWS[99], *ROWS[100:]]), None, "csv", ":102: .* remove the row"),
    "reversed": (text(rows=ROWS[::-1]), None, "csv", ":3: .* sort or mend the time column"),
    "time goes back": (text(rows=[*ROWS[:150], *ROWS[100:]]), None, "csv", ":152: .* sort or mend"),
    "a NaN": (text().replace(AT_50, "nan", 1), None, "csv", r':52: .* missing = \["nan"\] in a map given as --map'),
    "an empty cell": (text().replace(f",{AT_50},", ",,", 1), None, "csv", ":52: column vx_V: the cell is empty; mend"),
    "a unit in the header": (text("t_s [s],vx_V [V],vy_V [V]"), None, "csv", "is not known; did you mean t_s"),
    "capitals": (text("T_S,VX_V,VY_V"), None, "csv", "'T_S' is not known; did you mean t_s"),
    "decimal commas": (text(between=";").replace(".", ","), None, "csv", 'delimiter = ";", decimal = ","'),
    "a total at the end": (text() + "mean,0.1,0.2\n", None, "csv", ":202: .* mend or remove the row"),
    "a header alone": ("t_s,vx_V,vy_V\n", None, "csv", "no rows of numbers; give a file that holds a record"),
    "hexadecimal": (text().replace(AT_50, "0x10", 1), None, "csv", ":52: .* '0x10' is not a number; mend"),
    "a null of Parquet": (parquet(vx_V=pa.array([None, *X[1:]])), None, "parquet", "nan is no measurement; leave"),
    "texts of Parquet": (parquet(vx_V=[str(value) for value in X]), None, "parquet", "string is no number; map"),
    "vectors of unequal length": (matlab(x=X[:-1]), MAPPED, "mat", "unequal length .* map vectors of one record"),
    "complex": (matlab(x=X + 1j), MAPPED, "mat", "variable x is complex; save its real part"),
    "a text": (matlab(x="hello"), MAPPED, "mat", "variable x is text; give a variable of numbers"),
}  # fmt: skip


def written(tmp_path: Path, data: str | bytes, mapping: str | None, ending: str) -> tuple[Path, Path | None]:
    source, map_file = tmp_path / f"odd.{ending}", None
    source.write_bytes(data if isinstance(data, bytes) else data.encode())
    if mapping is not None:
        map_file = tmp_path / "odd.map.toml"
        map_file.write_text(mapping, encoding="utf-8")
    return source, map_file


@pytest.mark.parametrize("name", list(SOUND))
def test_a_sound_file_comes_in_as_it_was_written(tmp_path: Path, name: str) -> None:
    source, map_file = written(tmp_path, *SOUND[name])
    imported = import_file(ImportRequest(source, tmp_path / "o.arrow", map_file=map_file))
    capture = imported.capture
    assert (capture.tick_rate_Hz, capture.lost, imported.of_rows) == (1000.0, 0, len(T))
    np.testing.assert_allclose(capture.t_s, T, atol=1e-12)
    np.testing.assert_allclose(capture.sense_V, np.column_stack([X, Y]), atol=1e-12)


@pytest.mark.parametrize("name", list(REFUSED))
def test_all_others_are_one_line(tmp_path: Path, name: str) -> None:
    *given, told = REFUSED[name]
    source, map_file = written(tmp_path, *given)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=told) as caught:
        import_file(ImportRequest(source, tmp_path / "o.arrow", map_file=map_file))
    assert "\n" not in str(caught.value)
    assert str(source) in str(caught.value)
    assert not (tmp_path / "o.arrow").exists()


def test_an_index_of_pandas_is_the_time(tmp_path: Path) -> None:
    frame = pd.DataFrame({"vx_V": X, "vy_V": Y}, index=pd.Index(T, name="t_s"))
    frame.to_parquet(tmp_path / "p.parquet")
    capture = import_file(ImportRequest(tmp_path / "p.parquet", tmp_path / "o.arrow")).capture
    np.testing.assert_array_equal(capture.t_s, T)
