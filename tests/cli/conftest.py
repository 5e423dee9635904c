"""The command line as its tests drive it: in this process where that does, as a process where not."""

import contextlib
import io
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hil import cli
from hil.bench import examples
from tests.forked import Forked
from tests.made_once import made_once

Hil = Callable[..., tuple[int, str, str]]
Start = Callable[..., "subprocess.Popen[str]"]

WAIT_S = 120.0
"""How long a process may take before a test gives up on it; none of them needs a tenth of it."""


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def hil(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Hil:
    """`hil("verb", …)` in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        code = cli.execute(list(arguments))
        captured = capfd.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """`start("verb", …)` as a process in an empty folder, its output piped; killed if left behind."""
    with starting(tmp_path, subprocess.Popen) as launch:
        yield launch


@pytest.fixture
def forked(tmp_path: Path) -> Iterator[Start]:
    """The same as a fork of this process, where how it starts is not what is tested."""
    with starting(tmp_path, Forked) as launch:
        yield launch


@contextlib.contextmanager
def starting(folder: Path, kind: "type[subprocess.Popen[str]]") -> Iterator[Start]:
    """In that folder, by that class."""
    processes: list[subprocess.Popen[str]] = []

    def launch(*arguments: str) -> "subprocess.Popen[str]":
        process = kind(
            [sys.executable, "-m", "hil", *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield launch
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture
def short_bench(tmp_path: Path) -> str:
    """A bench file in the test's folder: S-slow for three seconds in lockstep, the last one scored."""
    return write_short_bench(tmp_path)


@pytest.fixture(scope="session")
def recorded_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the short bench file, one run of it in `runs`, and the board's truth in `truth.arrow`."""

    def record(place: Path) -> None:
        with contextlib.chdir(place):
            bench = write_short_bench(place)
            code = cli.execute(["run", bench, "--link", "inproc:s-slow", "--truth", "truth.arrow", "--note", "n"])
        assert code == 0

    return made_once(tmp_path_factory, "recorded", record)


@pytest.fixture
def recorded(recorded_once: Path, tmp_path: Path, hil: Hil) -> Path:
    """The folder of a short run, in the test's folder with all that belongs to it."""
    shutil.copytree(recorded_once, tmp_path, dirs_exist_ok=True)
    (folder,) = (tmp_path / "runs").iterdir()
    return folder


def write_short_bench(folder: Path) -> str:
    """Write the short bench file into ``folder``; its name."""
    text = in_lockstep("s-slow", duration_s=3.0, settle_s=2.0)
    assert 'name = "s-slow"' in text
    text = text.replace('name = "s-slow"', 'name = "short"')
    (folder / "short.bench.toml").write_text(text, encoding="utf-8")
    return "short.bench.toml"


def in_lockstep(example: str, *, duration_s: float, settle_s: float) -> str:
    """The bench file of an example, of a run in lockstep that is so long and is scored from `settle_s` on."""
    text = examples.find("bench", example).read_text(encoding="utf-8")
    for key, value in (("clock", '"lockstep"'), ("duration_s", duration_s), ("settle_s", settle_s)):
        text, found = re.subn(rf"^{key} = [^ #\n]+", f"{key} = {value}", text, flags=re.MULTILINE)
        assert found == 1, key
    return text


def finished(process: "subprocess.Popen[str]", wait_s: float = WAIT_S) -> tuple[int, str, str]:
    """Exit code and both outputs of a process that ends by itself."""
    out, err = process.communicate(timeout=wait_s)
    return process.returncode, out, err
