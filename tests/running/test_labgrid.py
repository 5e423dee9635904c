"""A board of a labgrid place: the lease is taken before, held, and given back on every way out."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import hil
from hil.bench import examples, load_bench
from hil.boards.labgrid import leased
from hil.errors import InputError
from hil.wire.errors import LinkError
from hil.wire.links import open_link

CLIENT = """\
#!/bin/sh
echo "$2 $3" >> {log}
case "$3" in
  acquire) [ "$2" = taken ] && {{ echo "labgrid-client: Error: place is already acquired by vm/other" >&2; exit 1; }};;
  show) echo "Place '$2':"; echo "  tags: floor=2, link={link}";;
esac
exit 0
"""


@pytest.fixture
def board() -> Iterator[str]:
    """The link of an emulated board that serves."""
    command = [sys.executable, "-m", "device_emulator", "examples/s-slow.scenario.toml", "--link", "pty"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        assert emulator.stdout is not None
        yield emulator.stdout.readline().split()[1]
        emulator.kill()


@pytest.fixture
def log(tmp_path: Path, board: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What a stand-in for labgrid's client was told."""
    return stand_in(tmp_path, board, monkeypatch)


def stand_in(place: Path, link: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    client = place / "labgrid-client"
    client.write_text(CLIENT.format(log=place / "log", link=link))
    client.chmod(0o755)
    monkeypatch.setenv("PATH", f"{place}:{os.environ['PATH']}")
    return place / "log"


def test_a_place_is_held_while_a_run_lasts(tmp_path: Path, log: Path, no_report: None, no_scan: None) -> None:
    seen: list[str] = []
    run = hil.run(
        load_bench(examples.find("bench", "s-slow")).with_(loop={"settle_s": 0.2, "duration_s": 0.5}),
        link="labgrid:gyro",
        arm=True,
        clock="lockstep",
        out=tmp_path / "runs",
        progress=lambda told: seen.append(log.read_text()) if told.stage == "run" else None,
    )
    assert len(run.capture) == 2000
    assert set(seen) == {"gyro acquire\ngyro show\n"}
    assert log.read_text() == "gyro acquire\ngyro show\ngyro release\n"


def test_without_consent_nothing_is_acquired(tmp_path: Path, log: Path) -> None:
    with pytest.raises(InputError, match="arm=True"):
        hil.run("s-slow", link="labgrid:gyro", out=tmp_path / "runs")
    assert not log.exists()


def test_a_place_of_somebody_else_is_refused(tmp_path: Path, log: Path) -> None:
    with pytest.raises(InputError, match="labgrid:taken: acquire refused: place is already acquired by vm/other"):
        hil.run("s-slow", link="labgrid:taken", arm=True, out=tmp_path / "runs")
    assert log.read_text() == "taken acquire\n"
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("link", ["", "pty:s-slow", "nonsense"])
def test_a_place_without_a_board_is_released(tmp_path: Path, link: str, monkeypatch: pytest.MonkeyPatch) -> None:
    log = stand_in(tmp_path, link, monkeypatch)
    with pytest.raises(InputError, match="labgrid:gyro") as raised, leased("gyro"):
        pass
    assert "\n" not in str(raised.value)
    assert log.read_text().endswith("gyro release\n")


def test_a_killed_host_leaves_no_lease(log: Path) -> None:
    code = "import time; from hil.boards.labgrid import leased\n"
    code += "with leased('gyro'): print('held', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as host:
        assert host.stdout is not None
        assert host.stdout.readline() == "held\n"
        assert not log.read_text().endswith("release\n")
        host.send_signal(signal.SIGKILL)
    until = time.monotonic() + 30.0
    while not log.read_text().endswith("gyro release\n") and time.monotonic() < until:
        time.sleep(0.05)
    assert log.read_text().endswith("gyro release\n")


def test_a_link_that_is_no_place_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for link in ("labgrid:-p", "labgrid:a b", "labgrid:"):
        with pytest.raises(LinkError):
            open_link(link)
    with pytest.raises(LinkError, match="acquired first"):
        open_link("labgrid:gyro")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(InputError, match="pipx install labgrid"), leased("gyro"):
        pass


@pytest.mark.skipif(
    shutil.which("labgrid-coordinator") is None, reason="labgrid is not on the path (pipx install labgrid)"
)
def test_labgrids_own_coordinator_gives_and_takes_back(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("LG_COORDINATOR", "127.0.0.1:20497")
    asked = ["labgrid-coordinator", "-l", "127.0.0.1:20497"]
    with subprocess.Popen(asked, stderr=subprocess.DEVNULL, cwd=tmp_path) as coordinator:  # it keeps files there
        try:

            def client(*words: str) -> str:
                command = ["labgrid-client", "-p", "gyro", *words]
                return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout

            until = time.monotonic() + 60.0
            while time.monotonic() < until:
                try:
                    client("create")
                    break
                except subprocess.CalledProcessError:
                    time.sleep(0.5)
            client("set-tags", "link=serial:/dev/ttyACM0")
            with leased("gyro") as link:
                assert link == "serial:/dev/ttyACM0"
                assert "acquired: None" not in client("show")
                with pytest.raises(InputError, match="acquire refused: You have already acquired"), leased("gyro"):
                    pass
                assert "acquired: None" not in client("show")
            assert "acquired: None" in client("show")
        finally:
            coordinator.kill()
