"""A package beside the bench, as pip would install it: for this process and for those it starts."""

import fcntl
import os
import pty
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from functools import reduce
from pathlib import Path

import numpy as np
import pytest

from hil.bench.examples import directory

Install = Callable[[str, str, str, str], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Installs a module of that text with one entry point: group, name, object of the module, text."""
    site = tmp_path / "site"

    def put(group: str, name: str, target: str, text: str) -> None:
        folder = site / f"brought_{name}-1.0.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: brought-{name}\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[{group}]\n{name} = brought_{name}:{target}\n")
        (site / f"brought_{name}.py").write_text(text)
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, f"brought_{name}", raising=False)  # of the test before
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]))

    return put


_KEPT = 64  # bytes
BROKEN = "import no_such_package\n"
"""A package that cannot be loaded."""


@pytest.fixture
def sensor() -> Iterator[str]:
    """A port at which the example's sensor writes a line a hundredth of a second."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    ended = threading.Event()
    thread = threading.Thread(target=_write, args=(ours, theirs, ended))
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        ended.set()
        thread.join()
        os.close(theirs)
        os.close(ours)


def _write(port: int, other_end: int, ended: threading.Event) -> None:
    """What nobody reads is not kept: who begins to listen hears what comes then."""
    begin, counter = time.monotonic(), 0
    while not ended.is_set():
        body = f"G,{counter % 256},{1000 + counter % 7}".encode()
        checksum = reduce(lambda found, byte: found ^ byte, body)
        if _waiting(other_end) < _KEPT:
            os.write(port, b"$" + body + f"*{checksum:02X}\r\n".encode())
        counter += 1
        time.sleep(max(0.0, begin + 0.01 * counter - time.monotonic()))


def _waiting(port: int) -> int:
    """Bytes that are there to be read."""
    return int.from_bytes(fcntl.ioctl(port, termios.FIONREAD, bytes(4)), sys.byteorder)


def example(module: str) -> str:
    """The text of a module of the example package."""
    return (directory() / "doors" / "doors" / f"{module}.py").read_text(encoding="utf-8")


def doubles(place: Path, rows: int = 400) -> Path:
    """A file of the example's format."""
    columns = [np.arange(rows) / 1000.0, np.sin(np.arange(rows)), np.zeros(rows)]
    np.column_stack(columns).astype("<f8").tofile(place)
    return place
