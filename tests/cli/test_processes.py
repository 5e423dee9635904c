"""The command line as processes: two of them over a pty, interrupted, terminated, left behind."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.bench import examples
from hil.boards.emulation import emulator
from hil.errors import InputError
from hil.numbers import count
from hil.records.capture import read_capture
from hil.records.truth import read_truth
from tests.cli.conftest import WAIT_S, Start, finished

pytestmark = pytest.mark.slow  # whole processes


def line_of(process: "subprocess.Popen[str]", stream: str) -> str:
    """The next line a running process prints."""
    pipe = getattr(process, stream)
    line: str = pipe.readline()
    return line.rstrip("\n")


def wait_for(process: "subprocess.Popen[str]", stage: str) -> None:
    """Read standard error up to the line that names a stage of the run."""
    said = []
    while (line := line_of(process, "stderr")) != stage:
        said.append(line)
        assert process.poll() is None, said


def children_of(parent: int) -> list[int]:
    """Process numbers of the children of a process."""
    return [int(word) for word in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]


@pytest.mark.long
def test_two_terminals(start: Start, short_bench: str) -> None:
    board = start("emulate", "s-slow", "--json")
    url = json.loads(line_of(board, "stdout"))["ready"]
    assert url.startswith("serial:/dev/pts/")
    code, out, err = finished(start("run", short_bench, "--link", url, "--arm", "--json"))
    assert code == 0, err
    assert json.loads(out)["samples"] == 12000
    code, _, err = finished(board)
    assert (code, err.splitlines()[-1]) == (
        0,
        "emulated board: the host hung up, and in lockstep the board ends with it",
    )


@pytest.mark.long
def test_busy_port_is_one_line(start: Start, short_bench: str) -> None:
    board = start("emulate", "s-slow")
    url = line_of(board, "stdout").removeprefix("ready ")
    host = start("run", short_bench, "--link", url, "--arm", "--clock", "paced", "--duration", "60")
    wait_for(host, "run")
    code, out, err = finished(start("run", short_bench, "--link", url, "--dry-run"))
    assert (code, out) == (2, "")
    assert url.removeprefix("serial:") in err.splitlines()[-1]
    host.send_signal(signal.SIGINT)
    assert finished(host)[0] == 130


@pytest.mark.beyond(1)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_run_goes_safe_and_closes_its_record(start: Start, tmp_path: Path, number: signal.Signals) -> None:
    host = start("run", "s-slow", "--truth", "truth.arrow")
    wait_for(host, "run")
    (folder,) = (tmp_path / "runs").iterdir()
    while not (folder / "capture.arrow").stat().st_size:
        assert host.poll() is None
    host.send_signal(number)
    code, out, err = finished(host)
    assert (code, out) == (130, "")
    assert "SAFE" in err
    assert err.splitlines()[-1] == "hil: interrupted"
    assert read_capture(folder / "capture.arrow").complete
    assert json.loads((folder / "result.json").read_text(encoding="utf-8"))["verdict"] == "interrupted"
    assert (folder / "report.html").stat().st_size > 0


def test_an_interrupted_run_tells_its_folder_as_json(start: Start, tmp_path: Path) -> None:
    host = start("run", "s-slow", "--json")
    wait_for(host, "run")
    (folder,) = (tmp_path / "runs").iterdir()
    while not (folder / "capture.arrow").stat().st_size:
        assert host.poll() is None
    host.send_signal(signal.SIGINT)
    code, out, _ = finished(host)
    told = json.loads(out)
    assert (code, told["exit_code"], told["remedy"]) == (130, 130, "run the command again")
    assert f"runs/{folder.name}" in told["error"]


def test_terminated_emulator_is_gone(start: Start, tmp_path: Path) -> None:
    board = start("emulate", "s-slow", "--truth", "truth.arrow")
    assert line_of(board, "stdout").startswith("ready serial:/dev/pts/")
    (child,) = children_of(board.pid)
    board.send_signal(signal.SIGTERM)
    assert finished(board) == (130, "", "hil: interrupted\n")
    assert not Path(f"/proc/{child}").exists()
    assert read_truth(tmp_path / "truth.arrow").tick.size == 0


def test_emulator_that_dies_in_use_is_the_error() -> None:
    def use_it() -> None:
        with emulator(examples.find("scenario", "s-slow")) as board:
            board.process.kill()
            board.process.wait()
            raise InputError("the link is gone")

    with pytest.raises(InputError, match=r"emulated board died: ended with code -9"):
        use_it()


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(1200)  # two runs, each in real time, and a trace, which takes what the machine has left
def test_demo_goes_the_whole_circle_in_real_time(start: Start, tmp_path: Path) -> None:
    code, out, err = finished(start("demo", "--duration", "10", "--name", "short", "--json"), wait_s=8 * WAIT_S)
    result = json.loads(out)
    assert code == {"good": 0, "failed": 1}[result["verdict"]], err
    assert result["clock"] == "paced"
    (folder,) = (one for one in (tmp_path / "runs").iterdir() if one.name == result["run"])
    last = int(read_capture(folder / "capture.arrow").tick[-1])
    assert last >= 39999  # a sample that follows a gap over the end ends the run as well
    assert result["samples"] + result["lost"] == last + 1
    assert result["parameters"]["kxx"]["truth"] == pytest.approx(1610719.4)
    assert result["angle_error_rms_rad"] is not None
    assert result["turnaround_us"]["p50"] > 0
    assert result["diagnosis"]["verdict"] == "explained"
    assert [effect["name"] for effect in result["diagnosis"]["effects"]] == ["cubic_stiffness"]
    folders = {folder.name.partition("-short")[2]: folder for folder in (tmp_path / "runs").iterdir()}
    assert folders.keys() == {"-before", "-trace", ""}
    assert folders[""].name == result["run"]
    before = json.loads((folders["-before"] / "result.json").read_text(encoding="utf-8"))
    assert result["angle_error_rms_rad"] < before["angle_error_rms_rad"] / 5.0
    page = (folders[""] / "report.html").read_text(encoding="utf-8")
    assert "What the residual shows" in page
    assert "Angle error before and after" in page
    assert not list((tmp_path / "runs").rglob("truth*"))


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """So many processes that never wait, ended with the block."""
    command = [sys.executable, "-c", "while True: pass"]
    running = [subprocess.Popen(command) for _ in range(processes)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


@pytest.mark.long
@pytest.mark.realtime(alone=True)  # it takes all of the machine
@pytest.mark.timeout(1200)
def test_what_the_demo_says_stays_right_on_a_busy_machine(start: Start, tmp_path: Path) -> None:
    """Before and after come first, and hold; what the machine missed is the machine's part and nobody else's."""
    with busy(os.cpu_count() or 1):
        code, out, err = finished(start("demo", "--duration", "10", "--name", "busy"), wait_s=8 * WAIT_S)
    folders = sorted((tmp_path / "runs").glob("*-busy"))
    assert len(folders) == 1, out + err
    folder = folders[0]
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    parts, answers = result["parts"], result["answers"]
    assert code == (0 if result["verdict"] == "good" else 1), err
    assert out.index("[effects.cubic_stiffness]") < out.index("the loop without it and with it") < out.index("verdict ")
    before, after = angles_rad(line_with(out, "angle error, rms"))
    # A loop that is open for a part of the time has errors of its own beside those of the model: nothing is claimed.
    (first,) = (tmp_path / "runs").glob("*-busy-before")
    earlier = json.loads((first / "result.json").read_text(encoding="utf-8"))
    told = (earlier["angle_error_rms_rad"], result["angle_error_rms_rad"])
    assert (before, after) == pytest.approx(told, rel=1e-2)
    slow = "failed" in (parts["machine"]["outcome"], earlier["parts"]["machine"]["outcome"])
    assert slow == ("do not\ncompare the models" in out)
    share = min(of["in_time"] / of["ticks"] for of in (answers, earlier["answers"]))
    assert (slow and share < 0.8) or after < before / 5.0
    if parts["machine"]["outcome"] == "good":
        assert parts["model"]["outcome"] == "complete"
    elif (
        parts["model"]["outcome"] != "complete"
    ):  # a record with hundreds of gaps may look as if something were missing
        assert "the machine's part failed, too" in parts["model"]["reason"]
    counted = ("in_time", "late", "unanswered", "lost_to_board", "lost_to_host", "stopped")
    # A row that follows a gap over the end ends the run, too: it is the last tick.
    assert sum(answers[part] for part in counted) == answers["ticks"] >= 40000
    assert f"{count(answers['in_time'])} of {count(answers['ticks'])}" in out
    if parts["machine"]["outcome"] == "failed":
        assert "this machine was too slow for its part" in out.partition("verdict ")[0]
        assert "this machine was too busy" in parts["machine"]["reason"]
        assert line_with(out, "verdict ").startswith(f"verdict  {result['verdict']}")
        assert out.splitlines()[-1] == f"next     {result['next']}"


def angles_rad(line: str) -> list[float]:
    """Every angle that a line tells with a prefix, as "210 µrad"."""
    sizes = {"": 1.0, "m": 1e-3, "µ": 1e-6, "n": 1e-9}
    return [float(number) * sizes[prefix] for number, prefix in re.findall(r"([\d.]+)\s([mµn]?)rad(?!/)", line)]


def line_with(text: str, start: str) -> str:
    """The first line that starts so."""
    return next(line for line in text.splitlines() if line.startswith(start))
