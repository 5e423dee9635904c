"""From the loop to the disk: record files written in place, or by a process of their own behind rings.

In lockstep the loop may write its files itself (`record_here`). In real time nothing may stand in its way:
it drops rows into rings and a child process, started here, drains them into the files (`record_apart`). Both
give the same `Recording`. When the loop is killed, the child still writes what the rings hold, without an
end marker.
"""

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from hil.records.layout import Layout
from hil.records.stream import BlockWriter
from hil.ring import Ring

_DRAIN_EVERY_S = 0.02
_RING_ROWS = 1 << 16
_NO_ROWS: Mapping[str, int] = {}


class Track(Protocol):
    """Where the rows of one file go."""

    @property
    def dropped(self) -> int:
        """Rows lost because the disk did not keep up."""

    def put(self, *values: float) -> bool:
        """Append one row, column by column; False when it was dropped."""

    def push(self, rows: npt.NDArray[np.void]) -> int:
        """Append rows of the layout's dtype; returns how many were taken."""


class Recording:
    """The open record files of a run, one `Track` each, by the file's stem (`capture`, `timing`, …).

    As a context manager: a body that ends well closes the files with their end marker; one that raises leaves
    them without it, and readers say "interrupted".
    """

    def __init__(self, tracks: Mapping[str, Track], finish: Callable[[bool], None]) -> None:
        self.tracks = tracks
        self._finish = finish

    def __getitem__(self, stem: str) -> Track:
        return self.tracks[stem]

    @property
    def dropped(self) -> dict[str, int]:
        """Rows dropped so far, per file."""
        return {stem: track.dropped for stem, track in self.tracks.items()}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._finish(kind is None)


def record_here(folder: Path, layouts: Mapping[str, Layout]) -> Recording:
    """Write `folder/<stem>.arrow` for each stem from this process."""
    writers = {stem: BlockWriter(folder / f"{stem}.arrow", layout) for stem, layout in layouts.items()}

    def finish(well: bool) -> None:
        for writer in writers.values():
            writer.close() if well else writer.abandon()

    return Recording(writers, finish)


def record_apart(
    folder: Path, layouts: Mapping[str, Layout], *, wait: bool = False, ring_rows: Mapping[str, int] = _NO_ROWS
) -> Recording:
    """Write `folder/<stem>.arrow` for each stem from a child process behind rings of `ring_rows[stem]` rows.

    Call it before the loop asks for real-time scheduling: the child is to run as an ordinary process. With
    `wait` (lockstep) a full ring holds the loop up instead of dropping rows. Leaving the recording waits
    until the files are closed; raises OSError when the child did not manage that.
    """
    names = {stem: f"{os.getpid()}-{time.monotonic_ns()}-{stem}" for stem in layouts}
    rings: dict[str, Ring] = {}
    try:
        for stem, layout in layouts.items():
            rings[stem] = Ring.create(names[stem], layout.dtype, ring_rows.get(stem, _RING_ROWS))
        child = _start_child(folder, layouts, names)
    finally:
        # both sides have them open by now: nothing is left behind in shared memory, however this ends
        for ring in rings.values():
            ring.unlink()
    if wait:
        for ring in rings.values():
            ring.while_full = lambda: child.poll() is None

    def finish(well: bool) -> None:
        for ring in rings.values():
            if well:
                ring.finish()
        _, complaint = child.communicate()  # closes its input, which is the word to end
        for ring in rings.values():
            ring.detach()
        if child.returncode:
            raise OSError(f"{folder}: the recorder failed: {complaint.decode(errors='replace').strip()[-300:]}")

    return Recording(rings, finish)


def _start_child(folder: Path, layouts: Mapping[str, Layout], names: Mapping[str, str]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "hil.records.recorder"]
    pipe = subprocess.PIPE
    # Who reads our standard output up to its end, after we were killed, has thereby waited for the files as well.
    output = os.dup(1)
    try:
        # a session of its own: Ctrl-C at the terminal is for the loop, which then closes the record properly
        child = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=pipe, pass_fds=(output,), start_new_session=True
        )
    finally:
        os.close(output)
    assert child.stdin is not None
    assert child.stdout is not None
    order = {stem: [names[stem], str(folder / f"{stem}.arrow"), layouts[stem].to_json()] for stem in layouts}
    child.stdin.write(json.dumps(order).encode() + b"\n")
    child.stdin.flush()
    if child.stdout.readline() != b"ready\n":
        _, complaint = child.communicate()
        raise OSError(f"{folder}: the recorder did not start: {complaint.decode(errors='replace').strip()[-300:]}")
    return child


def serve() -> None:
    """The child: attach to the rings named on standard input, drain them until it closes, then end the
    files.
    """
    order = json.loads(sys.stdin.buffer.readline())
    tracks = [
        (Ring.attach(name), BlockWriter(Path(path), Layout.from_json(layout))) for name, path, layout in order.values()
    ]
    # What carries a pty's bytes is an ordinary kernel thread: a recorder in its way would make answers late.
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    print("ready", flush=True)
    hung_up = False
    while not hung_up:
        hung_up = bool(select.select([sys.stdin], [], [], _DRAIN_EVERY_S)[0])
        for ring, writer in tracks:
            writer.push(ring.pop())
    for ring, writer in tracks:
        writer.push(ring.pop())
        writer.close() if ring.closed else writer.abandon()
        ring.detach()


if __name__ == "__main__":
    serve()
