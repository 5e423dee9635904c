"""A sensor that a package brings is one on every side: command line, library, service, client, pytest."""

import json
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

import hil
from hil.client import connect
from hil.errors import InputError
from tests.doors.conftest import BROKEN, Install, example
from tests.forked import hil_says
from tests.service.serving import Serving, serving
from tests.test_pytest_plugin import PLUGIN

pytestmark = pytest.mark.slow
pytest_plugins = ["pytester"]

SAYS = "brought_ascii:AsciiGyro cannot be loaded: No module named 'no_such_package'"
REMEDY = "mend or remove the package that brings it"


@pytest.fixture
def link(sensor: str, install: Install) -> str:
    """The sensor by the name of the package's adapter."""
    install("hil.boards", "ascii", "AsciiGyro", example("ascii_gyro"))
    return f"ascii:{sensor}"


@pytest.fixture
def broken(sensor: str, install: Install) -> str:
    """The same of a package that cannot be loaded."""
    install("hil.boards", "ascii", "AsciiGyro", BROKEN)
    return f"ascii:{sensor}"


def counted(result: dict[str, Any]) -> int:
    """Samples of a second, those too that a busy machine was late for."""
    return int(result["samples"] + result["lost"])


def on_the_command_line(link: str, runs: Path) -> "subprocess.CompletedProcess[str]":
    words = ["record", link, "--duration", "1", "--out", str(runs), "--json"]
    return hil_says(*words)


def by_a_job(service: Serving, link: str) -> dict[str, object]:
    row = service.ask("POST", "/api/jobs", json={"kind": "record", "link": link, "duration_s": 1.0}).json()
    while row.get("state") in ("queued", "running"):
        time.sleep(0.2)
        row = service.ask("GET", f"/api/jobs/{row['id']}").json()
    return row


def test_on_the_command_line(link: str, tmp_path: Path) -> None:
    done = on_the_command_line(link, tmp_path / "runs")
    assert counted(json.loads(done.stdout)) == 100, done.stderr


def test_in_the_library(link: str, tmp_path: Path) -> None:
    assert counted(hil.record(link, duration_s=1.0, out=tmp_path / "runs").result.model_dump()) == 100


def test_in_the_service_and_from_the_client(link: str, tmp_path: Path) -> None:
    with serving(tmp_path / "runs") as service, connect(service.url, service.token()) as client:
        row = by_a_job(service, link)
        assert row["state"] == "done", row
        made = hil.load(tmp_path / "runs" / row["result"]["run"])  # type: ignore[index]
        assert counted(made.result.model_dump()) == 100
        run = client.record(link, duration_s=1.0, note="from afar")
        assert (counted(run.result.model_dump()), run.result.operator_note) == (100, "from afar")


def test_in_pytest(link: str, pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        def test_it(sensor):
            result = sensor.record(duration_s=1.0).result
            assert result.samples + result.lost == 100
        """
    )
    pytester.runpytest_subprocess(*PLUGIN, "--hil-sensor", link).assert_outcomes(passed=1)


def test_a_broken_package_is_one_line_on_the_command_line(broken: str, tmp_path: Path) -> None:
    done = on_the_command_line(broken, tmp_path / "runs")
    assert done.returncode == 2
    assert done.stderr == f"hil: {broken}: {SAYS}; {REMEDY}\n"
    assert json.loads(done.stdout)["remedy"] == REMEDY
    assert hil_says("--help").returncode == 0


def test_a_broken_package_is_one_line_in_the_library(broken: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"^{broken}: {SAYS}; {REMEDY}$"):
        hil.record(broken, out=tmp_path / "runs")
    with pytest.raises(InputError, match=r"no adapter of that name; known: .*bosch-mm"):
        hil.record("absent:/dev/null", out=tmp_path / "runs")


def test_a_broken_package_is_one_line_in_the_service_which_goes_on(broken: str, tmp_path: Path) -> None:
    with serving(tmp_path / "runs") as service, connect(service.url, service.token()) as client:
        refused = service.ask("POST", "/api/jobs", json={"kind": "record", "link": broken})
        assert (refused.status_code, refused.json()) == (400, {"error": f"{broken}: {SAYS}", "remedy": REMEDY})
        with pytest.raises(InputError, match=SAYS):
            client.record(broken)
        assert service.ask("GET", "/api/runs").json()["runs"] == []


def test_a_broken_package_is_one_line_in_pytest(broken: str, pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_it(sensor):\n    sensor.record()\n\ndef test_other():\n    pass\n")
    result = pytester.runpytest_subprocess(*PLUGIN, "--hil-sensor", broken)
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines([f"*{broken}: {SAYS}; {REMEDY}"])


def test_a_request_names_no_file_that_is_no_port(link: str, tmp_path: Path) -> None:
    with serving(tmp_path / "runs") as service:
        for named in ("ascii:/etc/passwd", "ascii:/dev/null", "stim300:/dev/absent"):
            refused = service.ask("POST", "/api/jobs", json={"kind": "record", "link": named})
            assert refused.status_code == 400
            assert "no serial port of this machine" in refused.json()["error"]
