"""`hil run` as the processes it really is, to be stopped, killed and interrupted."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from hil.bench import Bench
from hil.records.capture import Capture, read_capture
from hil.records.runfolder import RunFolder
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.links import open_link
from hil.wire.messages import SafeReason, State
from tests.running.gyro import bench_file

PATIENCE_S = 120.0
# `python -m hil` without the page for people, which costs more than the rest of a short run.
_UNDRAWN = "import hil.running.concluding as c, hil.cli; c.artist = lambda _: c.nullcontext(); hil.cli.main()"


class Host:
    """One `hil run` in a session, and so a process group, of its own; its record goes below `place`.

    As a context manager it leaves no process behind, whatever was done to it. Its report is drawn where one is asked
    for.
    """

    def __init__(self, place: Path, declared: Bench, link: str, *, report: bool = False) -> None:
        place.mkdir(exist_ok=True)
        self._runs = place / "runs"
        command = ["run", str(bench_file(place / "test.bench.toml", declared)), "--link", link, "--arm"]
        self.process = subprocess.Popen(
            [sys.executable, *(["-m", "hil"] if report else ["-c", _UNDRAWN]), *command, "--out", str(self._runs)],
            env={**os.environ, "PYTHONWARNINGS": "error", "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        family = [self.process.pid] if alive(self.process.pid) else []
        for member in family:  # which grows meanwhile
            family += children(member)
        for member in family:
            os.kill(member, signal.SIGKILL)
        self.process.communicate()

    def await_stage(self, stage: str) -> None:
        """Wait until standard error names a stage; `run` comes with the first samples."""
        assert self.process.stderr is not None
        heard: list[str] = []
        while (line := self.process.stderr.readline()) != f"{stage}\n":
            assert line, f"ended before {stage!r}: {''.join(heard)}"
            heard.append(line)

    def await_record(self, samples: int = 1) -> None:
        """Wait until so many samples are on disk, a block at a time."""
        self.await_stage("run")
        until(lambda: len(self.capture) >= samples)

    def child(self, module: str) -> int:
        """Process number of the child that runs a module."""
        return next(child for child in children(self.process.pid) if module in command_line(child))

    @property
    def worker(self) -> int:
        """The process the loop runs in."""
        return self.child("hil.running.process.worker")

    def folders(self) -> list[Path]:
        """The run folders there are."""
        return list(self._runs.iterdir())

    @property
    def folder(self) -> RunFolder:
        """The one run folder."""
        (folder,) = self.folders()
        return RunFolder(folder)

    @property
    def capture(self) -> Capture:
        """The record as it is on disk now."""
        return read_capture(self.folder.capture_path)

    @property
    def result(self) -> dict[str, Any]:
        """What result.json says."""
        result: dict[str, Any] = json.loads(self.folder.result_path.read_text(encoding="utf-8"))
        return result

    def interrupt(self) -> None:
        """Ctrl-C at its terminal."""
        os.killpg(self.process.pid, signal.SIGINT)

    def ends(self) -> tuple[int, list[str]]:
        """Exit code and the lines on standard error since the last `await_stage`, once it has ended by itself."""
        _, said = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, said.splitlines()


def children(parent: int) -> list[int]:
    """Process numbers of the children of a process."""
    return [int(word) for word in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]


def command_line(process: int) -> list[str]:
    """How a process was started."""
    return Path(f"/proc/{process}/cmdline").read_text().split("\0")


def alive(process: int) -> bool:
    """Whether a process runs, be it stopped; an ended one that nobody has waited for does not."""
    try:
        return ") Z " not in Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False


def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@contextmanager
def stopped(process: int, seconds: float) -> Iterator[None]:
    """Stop a process for a while, as a debugger does; the block runs while it stands still."""
    os.kill(process, signal.SIGSTOP)
    try:
        yield
        time.sleep(seconds)
    finally:
        os.kill(process, signal.SIGCONT)


def safe_reason(url: str) -> SafeReason:
    """What a fresh host hears of why the board is in SAFE."""
    endpoint = Endpoint(open_link(url))
    client.connect(endpoint, 10.0)
    status = client.make_safe(endpoint, SafeReason.LINK_LOST)  # which covers no other reason
    endpoint.close()
    assert status.state == State.SAFE
    return SafeReason(status.reason)
