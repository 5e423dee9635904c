"""A random table written in a random dialect, imported by the map that describes it, equals what was written."""

import csv
import gzip
import io
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hil.errors import InputError
from hil.importing import text_source
from hil.importing.importer import import_file
from hil.importing.request import ImportRequest

WORDS = st.text(st.characters(codec="cp1252", exclude_characters="\r\n\0\"'\x85\xa0", min_codepoint=32), max_size=6)
NUMBERS = st.floats(-1e6, 1e6, allow_nan=False).map(lambda value: float(f"{value:.9g}"))


@st.composite
def written(draw: st.DrawFn) -> tuple[bytes, str, np.ndarray, bool]:
    """Bytes of a file, the text of its map, the values of its channel, whether it is gzipped."""
    delimiter = draw(st.sampled_from([",", ";", "\t", "|", " "]))
    decimal = draw(st.sampled_from([mark for mark in (".", ",") if mark != delimiter]))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le"]))
    header, units, comment = draw(st.booleans()), draw(st.booleans()), draw(st.sampled_from([None, "#", "%"]))
    thousands = draw(st.sampled_from([None, "'"]))
    values = np.array(draw(st.lists(NUMBERS, min_size=3, max_size=12)))
    width = draw(st.integers(1, 3))
    place = draw(st.integers(0, width - 1))
    quoting: Any = draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL])) if delimiter != " " else csv.QUOTE_MINIMAL
    out = io.StringIO()
    writer = csv.writer(out, delimiter=delimiter, quoting=quoting, lineterminator=draw(st.sampled_from(["\n", "\r\n"])))
    skipped = draw(st.integers(0, 3))
    for _ in range(skipped):
        out.write(f"Recorder {draw(WORDS)}\n")
    if header:
        writer.writerow([f"column{index}" for index in range(width)])
        if units:
            writer.writerow(["V"] * width)
    filler = st.just("x") if delimiter == " " else st.sampled_from(["a", "7", "ok,no", "p;q", "1 2"])
    for value in values:
        if comment is not None and draw(st.booleans()):
            out.write(f"{comment} {draw(WORDS)}\n")
        if draw(st.integers(0, 4)) == 0:
            out.write("\n")
        text = f"{value:,.12f}".replace(",", thousands or "") if draw(st.booleans()) else repr(float(value))
        text = text.replace(".", decimal)
        cells = [text if index == place else draw(filler) for index in range(width)]
        writer.writerow(cells)
    keys: dict[str, Any] = {
        "hold": "zoh",
        "sampling_rate_Hz": 10.0,
        "missing": [],
        "delimiter": delimiter,
        "decimal": decimal,
    }
    keys |= {"encoding": encoding, "header": header, "skip_lines": skipped}
    if header and units:
        keys["units_row"] = True
    if comment is not None:
        keys["comment"] = comment
    own = f', thousands = "{thousands}"' if thousands is not None else ""
    column = json.dumps(f"column{place}") if header else place + 1
    mapping = "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
    mapping += f'[columns]\nvx = {{ column = {column}, unit = "u"{own} }}\n'
    return out.getvalue().encode(encoding, "replace"), mapping, values, draw(st.booleans())


@pytest.mark.moderate
@settings(max_examples=75, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(written())
def test_what_was_written_is_read(made: tuple[bytes, str, np.ndarray, bool]) -> None:
    content, mapping, values, zipped = made
    with TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "a.csv").write_bytes(gzip.compress(content) if zipped else content)
        (place / "a.map.toml").write_text(mapping, encoding="utf-8")
        imported = import_file(ImportRequest(place / "a.csv", place / "a.arrow", map_file=place / "a.map.toml"))
        np.testing.assert_allclose(imported.capture.sense_V[:, 0], values, rtol=1e-11, atol=1e-11)
        assert imported.of_rows == len(values)


@pytest.mark.moderate
@settings(max_examples=75, deadline=None)
@given(st.text(st.sampled_from('01,;"\n.\t _e-x'), max_size=60), st.sampled_from([",", ";", "\t", " "]))
def test_whatever_a_file_holds_it_is_rows_or_one_line(body: str, delimiter: str) -> None:
    """Both readers, the quick one and the strict one, come to the same; nothing is dropped in silence."""
    outcomes = []
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        place = Path(folder)
        (place / "a.csv").write_text(f"a{delimiter}b\n{body}", encoding="utf-8", newline="")
        text = f'hold = "zoh"\nsampling_rate_Hz = 1.0\ndelimiter = {json.dumps(delimiter)}\nmissing = []\n'
        (place / "m.map.toml").write_text(text + '[columns]\nvx = { column = "a", unit = "u" }\n')
        for quick in (True, False):
            if not quick:
                patch.setattr(text_source, "plain_columns", lambda *_, **__: None)
            try:
                imported = import_file(ImportRequest(place / "a.csv", place / "a.arrow", map_file=place / "m.map.toml"))
            except InputError as error:
                outcomes.append(str(error))
            else:
                full = [line for line in body.split("\n") if line.strip()]
                assert imported.of_rows == len(full)
                outcomes.append(repr(imported.capture.sense_V[:, 0].tolist()))
    assert outcomes[0] == outcomes[1]
    assert "\n" not in outcomes[0]
