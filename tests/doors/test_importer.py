"""A format that a package brings is read as one of the bench's own."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hil.errors import InputError
from hil.interchange.importer import import_record
from tests.doors.conftest import Install

READER = """
import struct

def columns(path):
    data = path.read_bytes()
    values = struct.unpack(f"<{len(data) // 8}d", data)
    return {"t_s": values[0::3], "vx_V": values[1::3], "ux_mps2": values[2::3]}
"""
"""A file of doubles, three to a row."""


@pytest.fixture
def record(tmp_path: Path) -> Path:
    rows = np.column_stack([np.arange(400) / 1000.0, np.sin(np.arange(400)), np.zeros(400)])
    place = tmp_path / "drive.abc"
    place.write_bytes(rows.astype("<f8").tobytes())
    return place


def test_its_columns_become_a_capture(record: Path, tmp_path: Path, install: Install) -> None:
    install("hil.importers", "abc", "columns", READER)
    capture = import_record(record, tmp_path / "drive.arrow")
    assert len(capture) == 400
    assert capture.tick_rate_Hz == pytest.approx(1000.0)
    np.testing.assert_array_equal(capture.sense_V[:, 0], np.sin(np.arange(400)))


def test_the_command_line_reads_it(record: Path, tmp_path: Path, install: Install) -> None:
    install("hil.importers", "abc", "columns", READER)
    done = subprocess.run(
        [sys.executable, "-m", "hil", "import", str(record), "--out", str(tmp_path / "drive.arrow"), "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["samples"] == 400


def test_keys_of_a_text_do_not_act_on_it(record: Path, tmp_path: Path, install: Install) -> None:
    install("hil.importers", "abc", "columns", READER)
    (tmp_path / "a.map.toml").write_text('hold = "zoh"\ndelimiter = ";"\n')
    with pytest.raises(InputError, match=r"delimiter: acts on text only, and .*drive.abc is a .abc file"):
        import_record(record, tmp_path / "drive.arrow", map_file=tmp_path / "a.map.toml")


@pytest.mark.parametrize(
    ("target", "text", "said"),
    [
        ("columns", "import no_such_package\n", "cannot be loaded: No module named 'no_such_package'; mend or remove"),
        ("gone", READER, "cannot be loaded: .*; mend or remove the package that brings it"),
        ("columns", "def columns(path):\n    raise OSError('bad block')\n", "reads .abc files cannot: bad block"),
        ("columns", "def columns(path):\n    return 7\n", "reads .abc files cannot: "),
        ("columns", "def columns(path):\n    return {'t_s': [0.0, 1.0], 'vx_V': ['a', 'b']}\n", "drive.abc"),
    ],
)
def test_a_package_that_is_broken_is_one_line(
    record: Path, tmp_path: Path, install: Install, target: str, text: str, said: str
) -> None:
    install("hil.importers", "abc", target, text)
    with pytest.raises(InputError, match=said):
        import_record(record, tmp_path / "drive.arrow")
    assert not (tmp_path / "drive.arrow").exists()


def test_a_broken_package_is_in_no_other_files_way(tmp_path: Path, install: Install) -> None:
    install("hil.importers", "abc", "columns", "import no_such_package\n")
    rows = "".join(f"{k / 1000:.3f},{k % 7 / 10},0\n" for k in range(50))
    (tmp_path / "ride.csv").write_text(f"t_s,vx_V,ux_mps2\n{rows}")
    assert len(import_record(tmp_path / "ride.csv", tmp_path / "ride.arrow")) == 50
