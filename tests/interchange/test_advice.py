"""Every advice of the importer, followed, imports: it comes from the file's own structure."""

import re
from pathlib import Path

import numpy as np
import pytest

from hil.errors import InputError
from hil.importing.importer import import_file
from hil.importing.mapping import OF_TEXT
from hil.importing.request import ImportRequest

ROWS = 40
T = [f"{n * 0.01:.3f}" for n in range(ROWS)]
V = [f"{np.sin(n):.4f}" for n in range(ROWS)]


def table(delimiter: str, *, header: str = "time{d}out", decimal: str = ".", end: str = "", start: str = "") -> str:
    lines = [] if not header else [header.format(d=delimiter)]
    lines += [f"{start}{t}{delimiter}{v}{end}".replace(".", decimal) for t, v in zip(T, V, strict=True)]
    return "\n".join(lines) + "\n"


PREAMBLE = "Recorder 7\nSerial: 4711\n\n"
FILES: dict[str, str | bytes] = {
    "semicolons": table(";"),
    "tabs": table("\t"),
    "bars": table("|"),
    "blanks": table(" "),
    "runs of blanks": table("    ", start="  "),
    "decimal comma": table(";", decimal=","),
    "decimal comma, tabs": table("\t", decimal=","),
    "decimal comma, blanks": table("   ", decimal=",", start=" "),
    "no header": table(",", header=""),
    "no header, semicolons": table(";", header=""),
    "lines before": PREAMBLE + table(","),
    "lines before, semicolons": PREAMBLE + table(";"),
    "lines before, decimal comma": PREAMBLE + table(";", decimal=","),
    "lines before with commas": "a,b,c,d,e\nRecorder, 7, of, many\n" + table(","),
    "lines before, no header": PREAMBLE + table(",", header=""),
    "comments before": "# Recorder 7\n# of 2026\n" + table(","),
    "comments before, per cent": "% Recorder 7\n% a, b\n" + table("\t"),
    "a comment within": table(",").replace(T[9], f"# paused\n{T[9]}", 1),
    "comments before and within": "# r\n" + table(";").replace(T[9], f"# paused\n{T[9]}", 1),
    "names in a comment": "% Recorder 7\n" + table(",", header="% time, out"),
    "comments, no header": "# Recorder\n# made by hand\n" + table(",", header=""),
    "a line of units": table(",", header="time,out\ns,V"),
    "a line of units in brackets": table(";", header="time;out\n[s];[mm]"),
    "lines before and units": PREAMBLE + table("\t", header="time\tout\n(s)\t(V)"),
    "semicolons at the end": table(";", end=";"),
    "cp1252": ("\N{MICRO SIGN}s," + table(",", header="time{d}ä")).replace("\N{MICRO SIGN}s,", "", 1).encode("cp1252"),
    "UTF-16": table(",").encode("utf-16-le"),
    "UTF-16, the other way": table(",").encode("utf-16-be"),
    "UTF-16, semicolons": table(";").encode("utf-16-le"),
    "a quote that is a letter": table(",", header='time{d}out{d}remark', end=',"5" pipe'),
    "a quote that opens": table(",", header='time{d}out{d}remark', end=",").replace(f"{V[5]},", f'{V[5]},"loud', 1),
    "thousands": table(";").replace(f";{V[7]}", ";1,234.5"),
    "points between thousands": "time;out\n" + "".join(f"{n / 8};{n * 77:,}\n".replace(",", ".") for n in range(ROWS)),
    "9.9E37": table(",").replace(V[7], "9.9E37"),
    "-999": table(",").replace(V[7], "-999"),
    "nan": table(",").replace(V[7], "nan"),
    "milliseconds": "time,out\n" + "".join(f"{int(2.5 * n) / 1000:.3f},{v}\n" for n, v in enumerate(V)),
    "two of one name": table(",", header="time{d}out{d}out", end=",7"),
}  # fmt: skip
UNEVEN = {"uneven": "time,out\n" + "".join(f"{n + 0.3 * np.sin(n * n):.6f},{v}\n" for n, v in enumerate(V))}
UNEVEN["a gap"] = "time,out\n" + "".join(f"{n / 100:.2f},{v}\n" for n, v in enumerate(V) if n not in (20, 21))
_KEY = re.compile(
    rf'\b({"|".join((*OF_TEXT, "missing", "sampling_rate_Hz"))}) = ("(?:[^"\\]|\\.)*"|\[[^\]]*\]|[\w.+-]+)'
)


def follow(advised: str, keys: dict[str, str], columns: list[str]) -> bool:
    """Take what a line advises into the keys and columns of a map; whether there was anything."""
    advised = advised.partition(", or decimal")[0]
    found = {key: value for key, value in _KEY.findall(advised) if keys.get(key) != value}
    if "missing" in found:
        found["missing"] = next(value for key, value in _KEY.findall(advised) if key == "missing")
    keys |= found
    names = re.search(r"its columns are then (.*)$", advised) or re.search(r"the file has: (.*)$", advised)
    before = list(columns)
    if names is not None:
        columns[:] = [f'"{name}"' for name in names[1].split(", ")][:2]
    if keys.get("header") == "false":
        columns[:] = ["1", "2"]
    if (position := re.search(r"column = (\d+)", advised)) is not None:
        columns[1] = position[1]
    if (mark := re.search(r'thousands = "(.)" of this column', advised)) is not None:
        columns[1] += f', thousands = "{mark[1]}"'
    return bool(found) or before != columns


def attempt(place: Path, source: Path, keys: dict[str, str], columns: list[str]) -> int:
    unit = keys.get("unit", "s")
    own = "".join(f"{key} = {value}\n" for key, value in keys.items() if key != "unit")
    text = f'hold = "zoh"\n{own}[columns]\nt_s = {{ column = {columns[0]}, unit = "{unit}" }}\n'
    (place / "m.map.toml").write_text(text + f'vx = {{ column = {columns[1]}, unit = "u" }}\n', encoding="utf-8")
    imported = import_file(ImportRequest(source, place / "m.arrow", map_file=place / "m.map.toml"))
    return len(imported.capture) + imported.capture.lost


def told(place: Path, source: Path, keys: dict[str, str], columns: list[str]) -> str:
    """The line with which an attempt is refused; empty where it imports all rows."""
    try:
        rows = attempt(place, source, keys, columns)
    except InputError as error:
        return str(error)
    assert rows == ROWS
    return ""


def written(place: Path, name: str) -> Path:
    content = FILES[name]
    (place / "m.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    return place / "m.csv"


@pytest.mark.parametrize("name", FILES)
def test_an_advice_that_is_followed_imports(tmp_path: Path, name: str) -> None:
    source, keys = written(tmp_path, name), dict[str, str]()
    columns = ['"time"', '"ä"' if name == "cp1252" else '"out"']
    lines: list[str] = []
    while line := told(tmp_path, source, keys, columns):
        lines.append(line)
        assert follow(line, keys, columns), lines
        assert len(lines) < 4, lines
    assert lines, "nothing was to be told of it"
    assert not any("nonuniform" in line for line in lines)


@pytest.mark.parametrize("name", [name for name in FILES if name != "two of one name"])
def test_without_a_map_the_first_advice_is_of_the_same_structure(tmp_path: Path, name: str) -> None:
    """The header cannot be the interchange one; what is told about the dialect is what a map needs."""
    source = written(tmp_path, name)
    with pytest.raises(InputError) as caught:
        import_file(ImportRequest(source, tmp_path / "m.arrow"))
    line = str(caught.value)
    assert "\n" not in line
    keys, columns = dict[str, str](), ['"time"', '"out"']
    follow(line, keys, columns)
    if name == "cp1252":
        columns[1] = '"ä"'
    for _ in range(3):
        if line := told(tmp_path, source, keys, columns):
            assert follow(line, keys, columns), line
    assert not line


@pytest.mark.parametrize(
    ("start", "keys"),
    [
        ("", {}),
        ("# Recorder 7\n", {"comment": '"#"'}),
        ("# Recorder 7\n", {"skip_lines": "1"}),
        ("# Recorder 7\n", {"skip_lines": "1", "comment": '"#"'}),
        ("Recorder 7\n# paused\n", {"skip_lines": "1", "comment": '"#"'}),
        ("", {"comment": '"#"'}),
    ],
)
def test_a_misspelt_column_of_a_text_that_the_map_reads_rightly(
    tmp_path: Path, start: str, keys: dict[str, str]
) -> None:
    """The name is the only mistake, whichever way the lines before the table are left out."""
    (tmp_path / "m.csv").write_text(start + table(",", header="time{d}Fx g"))
    line = told(tmp_path, tmp_path / "m.csv", keys, ['"time"', '"Fx_g"'])
    assert line.endswith("no column 'Fx_g' for vx; did you mean 'Fx g'?")
    assert not told(tmp_path, tmp_path / "m.csv", keys, ['"time"', '"Fx g"'])


def test_a_comment_mark_that_hides_the_header_is_to_be_left_out(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(table(",", header="% time{d}out"))
    line = told(tmp_path, tmp_path / "m.csv", {"comment": '"%"'}, ['"% time"', '"out"'])
    assert line.endswith("; leave comment out; its columns are then % time, out")
    assert not told(tmp_path, tmp_path / "m.csv", {}, ['"% time"', '"out"'])


@pytest.mark.parametrize("name", UNEVEN)
def test_nonuniform_is_advised_for_what_is_uneven_or_lacks_samples(tmp_path: Path, name: str) -> None:
    source = tmp_path / "m.csv"
    source.write_text(UNEVEN[name].replace("time,out", "t_s,vx_V"))
    with pytest.raises(InputError, match="give --nonuniform"):
        import_file(ImportRequest(source, tmp_path / "m.arrow"))
    capture = import_file(ImportRequest(source, tmp_path / "m.arrow", nonuniform=True)).capture
    assert capture.uniform == (name == "a gap")
    assert capture.lost == (2 if name == "a gap" else 0)
