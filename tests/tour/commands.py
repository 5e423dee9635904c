"""The commands that README.md and docs/tutorial.md show, and what is needed for them beside a terminal."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "docs/tutorial.md")
DATA = Path(os.environ.get("HIL_DATA", ROOT.parent / "shared" / "data")) / "silverbox"
WAIT_S = 1800.0

_SHOWN = re.compile(r"^    ((?:hil|sha256sum) .+?)(?:  .*)?$")
_BOARD = "serial:/dev/pts/3"
_SENSOR = "serial:/dev/ttyUSB0"
_SERVES = {
    "hil emulate s-slow": (["-m", "hil", "emulate", "s-slow"], "ready "),
    "hil serve": (["-m", "hil", "serve", "--port", "0"], "http://127.0.0.1:"),
}
"""What serves until it is told to end, as it is started here, and how its first line begins."""
_NEEDS_ANOTHER = ("serial:/dev/ttyACM0", "my.bench.toml", "mount.toml")
"""Of a command that a board, or several, of one's own are needed for."""
_MAY_FAIL = ("run", "demo", "trace", "score", "compare", "doctor", "replay", "record")
"""Verbs that leave with 1 where their verdict is against what they looked at (docs/reference/cli.md)."""


class Done(NamedTuple):
    """A command that was run: its exit code, seconds, and what it wrote."""

    command: str
    code: int
    seconds: float
    output: str

    @property
    def as_documented(self) -> bool:
        """Whether it left as docs/reference/cli.md says, without escape sequences and without a traceback."""
        verb = self.command.split()[1]
        allowed = (0, 1) if self.command.startswith("hil") and verb in _MAY_FAIL else (0,)
        return self.code in allowed and "\033" not in self.output and "Traceback" not in self.output


def commands(page: str) -> list[str]:
    """The commands of a page, in its order, without their remarks; those for a board of one's own left out."""
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    shown = [found[1] for line in lines if (found := _SHOWN.match(line))]
    return [command for command in shown if not any(word in command for word in _NEEDS_ANOTHER)]


def available(command: str) -> bool:
    """Whether what the command reads can be had here."""
    measured = "SNLS80mV" in command or "silverbox" in command
    return not measured or any(DATA.glob("SNLS80mV.csv*"))


def run(command: str, place: Path) -> Done:
    """The command in a shell at `place`, 80 columns, no colour; with a board or a sensor where it names one."""
    for name in ("SNLS80mV.csv", "SNLS80mV.csv.gz"):
        source = DATA / "SNLS80mV.csv.gz"
        if name in command.split() and source.exists() and not (place / name).exists():
            (place / name).symlink_to(source)
    if _BOARD in command:
        with _served(["-m", "hil", "emulate", "s-slow"], "ready ") as url:
            return _run(command.replace(_BOARD, url), place)
    if _SENSOR in command:
        with _served(["-m", "device_emulator.gyros", "stim300"], "ready ") as url:
            return _run(command.replace(_SENSOR, f"serial:{url.partition(':')[2]}"), place)
    if command in _SERVES:
        begin = time.monotonic()
        with _served(*_SERVES[command], place) as url:
            return Done(command, 0, time.monotonic() - begin, url)
    return _run(command, place)


def _run(command: str, place: Path) -> Done:
    begin = time.monotonic()
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=place,
        env=_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    return Done(command, done.returncode, time.monotonic() - begin, done.stdout)


@contextmanager
def _served(arguments: list[str], word: str, place: Path | None = None) -> Iterator[str]:
    """What a process says behind `word`, which ends with the block; it works at `place`."""
    process = subprocess.Popen(
        [sys.executable, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        env=_environment(),
        cwd=place,
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith(word), line
        yield line.removeprefix(word).strip()
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60.0)


def _environment() -> dict[str, str]:
    here = {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb", "PYTHONPATH": str(ROOT)}
    return {**os.environ, **here, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
