"""A format that a package brings is read on every side: command line, library, service, client, pytest."""

import json
import time
from pathlib import Path

import numpy as np
import pytest

import hil
from hil.client import connect
from hil.errors import InputError
from hil.importing.importer import import_record
from tests.doors.conftest import BROKEN, Install, doubles
from tests.forked import hil_says
from tests.service.serving import Serving, serving
from tests.test_pytest_plugin import PLUGIN

pytest_plugins = ["pytester"]

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
    return doubles(tmp_path / "drive.abc")


def test_its_columns_become_a_capture(record: Path, tmp_path: Path, install: Install) -> None:
    install("hil.importers", "abc", "columns", READER)
    capture = import_record(record, tmp_path / "drive.arrow")
    assert len(capture) == 400
    assert capture.tick_rate_Hz == pytest.approx(1000.0)
    np.testing.assert_array_equal(capture.sense_V[:, 0], np.sin(np.arange(400)))


def test_the_command_line_reads_it(record: Path, tmp_path: Path, install: Install) -> None:
    install("hil.importers", "abc", "columns", READER)
    done = hil_says("import", str(record), "--out", str(tmp_path / "drive.arrow"), "--json")
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


def test_the_library_reads_it(record: Path, tmp_path: Path, install: Install) -> None:
    install("hil.importers", "abc", "columns", READER)
    imported = hil.import_record(record, out=tmp_path / "made.arrow")
    assert (imported.path, len(imported.capture)) == (tmp_path / "made.arrow", 400)
    with pytest.raises(InputError, match=r"exists already; give another name, or replace="):
        hil.import_record(record, out=tmp_path / "made.arrow")


def by_a_job(service: Serving, record: Path) -> dict[str, object]:
    sent = service.ask("POST", "/api/uploads", files={"record": (record.name, record.read_bytes())})
    if sent.status_code != 201:
        return dict(sent.json())
    row = service.ask("POST", "/api/jobs", json={"kind": "import", "upload": sent.json()["id"]}).json()
    while row.get("state") in ("queued", "running"):
        time.sleep(0.2)
        row = service.ask("GET", f"/api/jobs/{row['id']}").json()
    return dict(row)


@pytest.mark.slow
def test_the_service_reads_it_and_the_client_sends_it_with_its_map(
    record: Path, tmp_path: Path, install: Install
) -> None:
    install("hil.importers", "abc", "columns", READER)
    (tmp_path / "mine.map.toml").write_text('hold = "foh"\n')
    with serving(tmp_path / "runs") as service, connect(service.url, service.token()) as client:
        row = by_a_job(service, record)
        assert row["state"] == "done", row
        assert row["result"]["samples"] == 400  # type: ignore[index]
        run = client.import_record(record, name="ride", mapping=tmp_path / "mine.map.toml")
        assert len(run.capture) == 400
        assert run.capture.header["hold"] == "foh"


@pytest.mark.slow
def test_pytest_reads_it(record: Path, install: Install, pytester: pytest.Pytester) -> None:
    install("hil.importers", "abc", "columns", READER)
    pytester.makepyfile("def test_it(record):\n    assert len(record.capture) == 400\n")
    pytester.runpytest_subprocess(*PLUGIN, "--hil-record", str(record)).assert_outcomes(passed=1)


SAYS = "brought_abc:columns cannot be loaded: No module named 'no_such_package'"
REMEDY = "mend or remove the package that brings it"


def test_a_broken_package_is_one_line_on_the_command_line(record: Path, tmp_path: Path, install: Install) -> None:
    install("hil.importers", "abc", "columns", BROKEN)
    words = ["import", str(record), "--out", str(tmp_path / "made.arrow"), "--json"]
    done = hil_says(*words)
    assert done.returncode == 2
    assert done.stderr == f"hil: {record}: {SAYS}; {REMEDY}\n"
    assert json.loads(done.stdout)["remedy"] == REMEDY


@pytest.mark.slow
def test_a_broken_package_is_one_line_in_the_service_which_goes_on(
    record: Path, tmp_path: Path, install: Install
) -> None:
    install("hil.importers", "abc", "columns", BROKEN)
    rows = "".join(f"{k / 1000:.3f},{k % 7 / 10},0\n" for k in range(50))
    (tmp_path / "ride.csv").write_text(f"t_s,vx_V,ux_mps2\n{rows}")
    with serving(tmp_path / "runs") as service:
        row = by_a_job(service, record)
        assert (row["state"], row["error"]) == ("failed", f"drive.abc: {SAYS}; {REMEDY}")
        assert by_a_job(service, tmp_path / "ride.csv")["state"] == "done"


@pytest.mark.slow
def test_a_broken_package_is_one_line_in_pytest(record: Path, install: Install, pytester: pytest.Pytester) -> None:
    install("hil.importers", "abc", "columns", BROKEN)
    pytester.makepyfile("def test_it(record):\n    pass\n\ndef test_other():\n    pass\n")
    result = pytester.runpytest_subprocess(*PLUGIN, "--hil-record", str(record))
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines([f"*{record}: {SAYS}; {REMEDY}"])
