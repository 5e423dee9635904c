"""A link that a package brings is one on every side: command line, library, service, page for a run, pytest."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

import hil
from hil.bench import Bench
from hil.bench.template import template, values_of
from hil.boards.emulation import emulator
from hil.client import connect
from tests.doors.conftest import Install
from tests.forked import hil_says
from tests.running import gyro
from tests.service.serving import serving
from tests.test_pytest_plugin import PLUGIN

pytestmark = pytest.mark.slow
pytest_plugins = ["pytester"]

CARRIER = """
from hil.wire.links import open_link

def open_carrier(rest):
    return open_link(f"serial:{rest}")
"""


@pytest.fixture
def link(tmp_path: Path, install: Install) -> Iterator[str]:
    """An emulated board behind the package's scheme."""
    install("hil.links", "carrier", "open_carrier", CARRIER)
    with emulator(gyro.unhurried_scenario(tmp_path / "board.toml")) as there:
        yield there.url.replace("serial:", "carrier:")


@pytest.fixture
def bench(tmp_path: Path) -> tuple[Bench, Path]:
    """A second in lockstep, as an object and as a file."""
    declared = gyro.unhurried_bench(1.0).with_(loop={"clock": "lockstep"})
    place = tmp_path / "short.bench.toml"
    place.write_text(template(values_of(declared), ""))
    return declared, place


def test_on_the_command_line(link: str, bench: tuple[Bench, Path], tmp_path: Path) -> None:
    words = ["run", str(bench[1]), "--link", link, "--arm", "--out", str(tmp_path / "runs"), "--json"]
    done = hil_says(*words)
    assert json.loads(done.stdout)["samples"] == 400, done.stderr


def test_in_the_library(link: str, bench: tuple[Bench, Path], tmp_path: Path) -> None:
    run = hil.run(bench[0], link=link, arm=True, out=tmp_path / "runs")
    assert run.result.samples == 400


def test_in_the_service_once_it_is_listed(link: str, bench: tuple[Bench, Path], tmp_path: Path) -> None:
    with serving(tmp_path / "runs", "--link", link) as service, connect(list(service.links.values())[-1]) as client:
        with client.board("test") as board:
            board.connect(link)
            run = board.start(bench[0], arm=True).finished()
        assert run.result.samples == 400


def test_with_a_page_for_the_run(link: str, bench: tuple[Bench, Path], tmp_path: Path) -> None:
    words = ["run", str(bench[1]), "--link", link, "--arm", "--live", "--out", str(tmp_path / "runs"), "--json"]
    done = hil_says(*words)
    assert json.loads(done.stdout)["samples"] == 400, done.stderr


def test_in_pytest(link: str, bench: tuple[Bench, Path], pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_runs(board):\n    assert board.run(duration_s=1.0).result.samples == 400\n")
    options = ("--hil-bench", str(bench[1]), "--hil-link", link, "--hil-arm")
    pytester.runpytest_subprocess(*PLUGIN, *options).assert_outcomes(passed=1)
