"""Text records are read by Arrow where they are plain, and with the same outcome as by the reader that tells lines."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.errors import InputError
from hil.interchange import table
from hil.interchange.fast_table import read_plain_columns

PLAIN = "a,b,c\n1,2,3\n4,5.5,-6e-3\n7,8,9\n"
TEXTS: dict[str, str | bytes] = {
    "plain": PLAIN,
    "no end of line at the end": PLAIN.rstrip("\n"),
    "CRLF": PLAIN.replace("\n", "\r\n"),
    "CR alone": PLAIN.replace("\n", "\r"),
    "BOM": "\ufeff" + PLAIN,
    "spaces": "a, b, c\n 1 ,\t2, 3\n4 , 5,6 \n",
    "blank lines": "a,b,c\n\n1,2,3\n\n\n4,5,6\n\n",
    "blank lines with spaces": "a,b,c\n1,2,3\n   \n4,5,6\n",
    "blank lines before": "\n\na,b,c\n1,2,3\n",
    "blank cells in a row": "a,b,c\n1,2,3\n,,\n4,5,6\n",
    "quoted": 'a,b,c\n"1","2","3"\n4,"5",6\n',
    "a quoted line feed": 'a,b,c\n"1\n",2,3\n4,5,6\n',
    "a quote that stays open": 'a,b,c\n1,2,3\n4,"5,6\n7,8,9\n',
    "delimiter at the end of all": "a,b,c,\n1,2,3,\n4,5,6,\n",
    "delimiter at the end of the header": "a,b,c,\n1,2,3\n4,5,6\n",
    "delimiter at the end of rows": "a,b,c\n1,2,3,\n4,5,6,\n",
    "delimiter at the end of one row": "a,b,c\n1,2,3\n4,5,6,\n",
    "text beyond the delimiter": "a,b,c\n1,2,3,x\n4,5,6,\n",
    "short row": "a,b,c\n1,2,3\n4,5\n",
    "long row": "a,b,c\n1,2,3\n4,5,6,7\n",
    "one column": "a\n1\n2\n",
    "one column with blanks": "a\n1\n\n2\n",
    "words elsewhere": "a,b,c\n1,on,3\n2,off,4\n",
    "an empty cell": "a,b,c\n1,2,3\n4,5,\n",
    "nan": "a,b,c\n1,2,3\n4,5,nan\n",
    "NaN": "a,b,c\n1,2,NaN\n",
    "NA": "a,b,c\n1,2,NA\n",
    "inf": "a,b,c\n1,2,inf\n",
    "a power beyond all": "a,b,c\n1,2,1e999\n",
    "a power below all": "a,b,c\n1,2,1e-999\n",
    "null": "a,b,c\n1,2,null\n",
    "a word": "a,b,c\n1,2,3\n4,5,six\n",
    "underscores": "a,b,c\n1,2,1_000\n",
    "hexadecimal": "a,b,c\n1,2,0x10\n",
    "Fortran's exponent": "a,b,c\n1,2,1d5\n",
    "signs and points": "a,b,c\n+1,.5,1.\n-0,-.5e+3,1E5\n",
    "other digits": "a,b,c\n1,2,٣\n",
    "comma for the point": 'a,b,c\n1,2,"3,5"\n',
    "a comment": "a,b,c\n# no\n1,2,3\n",
    "header only": "a,b,c\n",
    "nothing": "",
    "zero bytes": b"a,b,c\n1,2,3\n4,5,\x00\n",
    "latin": "a,b,c\n1,2,3\n4,ä,6\n".encode("latin-1"),
    "gzip": gzip.compress(PLAIN.encode()),
    "gzip cut": gzip.compress(PLAIN.encode() * 40)[:-12],
    "long": "a,b,c\n" + "1,2,3\n" * 40_000,
    "long with a fault": "a,b,c\n" + "1,2,3\n" * 40_000 + "1,2,x\n",
}
WAYS: dict[str, dict[str, Any]] = {
    "all": {"columns": (0, 2), "names": ("a", "c")},
    "twice": {"columns": (2, 2), "names": ("c", "c again")},
    "no header": {"columns": (0,), "names": ("a",), "header": False},
    "a line skipped": {"columns": (0, 2), "names": ("a", "c"), "skip_lines": 1},
    "rows": {"columns": (0, 2), "names": ("a", "c"), "rows": (1, 2)},
    "rows beyond": {"columns": (0, 2), "names": ("a", "c"), "rows": (9, 12)},
    "semicolons": {"columns": (0,), "names": ("a",), "delimiter": ";"},
}


def outcome(path: Path, way: dict[str, Any]) -> tuple[str, Any, Any]:
    given = dict(way)
    try:
        read = table.read_columns(path, given.pop("columns"), given.pop("names"), **given)
    except InputError as error:
        return str(error), None, None
    except IndexError as error:
        return f"IndexError {error}", None, None
    return "", read.values, read.lines


@pytest.mark.beyond(120)
@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("text", TEXTS)
def test_both_readers_come_to_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, way: str) -> None:
    content = TEXTS[text]
    path = tmp_path / "a.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    said, values, lines = outcome(path, WAYS[way])
    monkeypatch.setattr(table, "read_plain_columns", lambda *_, **__: None)
    told, slow_values, slow_lines = outcome(path, WAYS[way])
    assert said == told
    np.testing.assert_array_equal(values, slow_values)
    np.testing.assert_array_equal(lines, slow_lines)


@pytest.mark.moderate
def test_plain_files_go_the_fast_way_and_to_the_last_bit(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    bits = random.integers(0, 1 << 64, 20_000, dtype=np.uint64)
    numbers = bits.view(np.float64)
    numbers = numbers[np.isfinite(numbers)]
    path = tmp_path / "a.csv"
    path.write_text("v\n" + "\n".join(map(repr, numbers.tolist())) + "\n", encoding="utf-8")
    read = read_plain_columns(path, (0,), width=1, delimiter=",", skip=1)
    assert read is not None
    np.testing.assert_array_equal(read[:, 0].view(np.uint64), numbers.view(np.uint64))
