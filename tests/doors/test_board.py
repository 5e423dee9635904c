"""An emulated board that a package brings is one on every side: command line, library, service, `--live`, pytest."""

import json
import subprocess
from pathlib import Path

import pytest

import hil
from hil.bench.template import template, values_of
from hil.client import connect
from hil.errors import InputError
from hil.wire.inproc import open_inproc
from hil.wire.link_name import Emulated, parse_link
from tests.doors.conftest import BROKEN, Install
from tests.forked import hil_says
from tests.running import gyro
from tests.service.serving import serving
from tests.test_pytest_plugin import PLUGIN

pytestmark = pytest.mark.slow
pytest_plugins = ["pytester"]

OTHER = """
from pathlib import Path

from device_emulator.inprocess import open_board as own

def open_board(scenario, truth, seed, **changes):
    Path(f"{scenario}.asked").touch()
    return own(scenario, truth, seed, **changes)
"""
"""It leaves a mark beside its scenario."""


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A second in lockstep, beside its scenario."""
    declared = gyro.unhurried_bench(1.0).with_(loop={"clock": "lockstep"})
    place = tmp_path / "short.bench.toml"
    place.write_text(template(values_of(declared), ""))
    gyro.unhurried_scenario(tmp_path / "board.scenario.toml")
    return place


@pytest.fixture
def link(bench: Path, install: Install) -> str:
    install("hil.emulators", "other", "open_board", OTHER)
    return f"inproc:{bench.with_name('board.scenario.toml')}?emulator=other"


def asked(bench: Path) -> bool:
    return bench.with_name("board.scenario.toml.asked").exists()


def on_the_command_line(bench: Path, link: str, *more: str) -> "subprocess.CompletedProcess[str]":
    words = ["run", str(bench), "--link", link, "--out", str(bench.parent / "runs"), "--json", *more]
    return hil_says(*words)


@pytest.mark.parametrize("more", [(), ("--live",)])
def test_on_the_command_line_and_with_a_page(link: str, bench: Path, more: tuple[str, ...]) -> None:
    done = on_the_command_line(bench, link, *more)
    assert json.loads(done.stdout)["samples"] == 400, done.stderr
    assert asked(bench)


def test_in_the_library(link: str, bench: Path, tmp_path: Path) -> None:
    assert hil.run(bench, link=link, out=tmp_path / "runs").result.samples == 400
    assert asked(bench)


def test_in_the_service(link: str, bench: Path, tmp_path: Path) -> None:
    with serving(tmp_path / "runs") as service, connect(service.url, service.token()) as client:
        named = "inproc:board.scenario.toml?emulator=other"
        assert client.load(client.job("run", bench=bench.name, link=named)["result"]["run"]).result.samples == 400
    assert asked(bench)


def test_in_pytest(link: str, bench: Path, pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_runs(board):\n    assert board.run(duration_s=1.0).result.samples == 400\n")
    pytester.runpytest_subprocess(*PLUGIN, "--hil-bench", str(bench), "--hil-link", link).assert_outcomes(passed=1)
    assert asked(bench)


def test_a_broken_package_is_one_line_and_in_no_other_boards_way(bench: Path, install: Install, tmp_path: Path) -> None:
    install("hil.emulators", "other", "open_board", BROKEN)
    own = f"inproc:{bench.with_name('board.scenario.toml')}"
    says = "brought_other:open_board cannot be loaded: No module named 'no_such_package'; mend or remove the package"
    done = on_the_command_line(bench, f"{own}?emulator=other")
    assert done.returncode == 2
    assert says in done.stderr.splitlines()[-1]  # behind how far it was
    assert "Traceback" not in done.stderr
    with pytest.raises(hil.WireError, match=says):
        hil.run(bench, link=f"{own}?emulator=other", out=tmp_path / "runs")
    with serving(tmp_path / "served") as service, connect(service.url, service.token()) as client:
        with pytest.raises(InputError, match=says):
            client.job("run", bench=bench.name, link="inproc:board.scenario.toml?emulator=other")
        assert client.job("run", bench=bench.name, link="inproc:board.scenario.toml")["state"] == "done"
    assert hil.run(bench, link=own, out=tmp_path / "runs").result.samples == 400


def test_what_it_does_wrong_is_one_line(bench: Path, install: Install) -> None:
    install("hil.emulators", "other", "open_board", "def open_board(*given, **more):\n    raise KeyError('truth')\n")
    with pytest.raises(hil.WireError, match="the emulator other cannot: 'truth'"):
        open_inproc(Emulated("inproc", "a", emulator="other"))
    with pytest.raises(hil.WireError, match="no emulator of that name; known: device_emulator, other"):
        open_inproc(Emulated("inproc", "a", emulator="absent"))


def test_a_link_names_it_again() -> None:
    assert parse_link("inproc:a?emulator=other").url == "inproc:a?emulator=other"
    with pytest.raises(hil.WireError, match="bad option"):
        parse_link("pty:a?emulator=other")
