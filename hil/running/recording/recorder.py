"""From the loop to the disk: record files written in place, or by a process of their own behind rings.

In lockstep the loop may write its files itself (`record_here`). In real time nothing may stand in its way:
it drops rows into rings and a child process, started here, drains them into the files (`record_apart`). Both
give the same `Recording`. When the loop is killed, the child still writes what the rings hold, without an
end marker.
"""

import json
import math
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from functools import partial
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from hil.errors.ending import ExitCode
from hil.records.layout import Layout
from hil.records.pyramid import KINDS, Pyramid
from hil.records.stream import BlockWriter
from hil.running import realtime
from hil.running.recording.ring import Ring

_DRAIN_EVERY_S = 0.02
_RING_ROWS = 1 << 16
_NO_ROWS: Mapping[str, int] = {}
_STUCK_S = 2.0  # without taking a row of those that wait, though it had a processor or slept …
_STARVED_S = 10.0  # … and at all: on a busy machine it is the last to run
_FLAGS, _PENDING = 9 - 3, 31 - 3  # fields of /proc/PID/stat, of those behind the name
_EXITING = 0x4  # PF_EXITING
_DYING_S = 0.3  # that it may take to tell its exit code
_OF_PROCESS = 2  # CPUCLOCK_SCHED: clock_getcpuclockid(3), which Python has of threads only
_ROW = 4096  # bytes, longer than it ever is
_CLOSING_S = 20.0  # for the files to be closed, once it has been told to


class RecorderError(OSError):
    """The record of a run ended before the run did. One line that says why."""


class Track(Protocol):
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
    them without it, and readers say "interrupted". Raises RecorderError when the files could not be closed well.

    `trouble` says why nothing is recorded any more, one line, "" while all is well; it costs microseconds. `busy_s`
    says for how long, s, the process that writes has had a processor since it began, 0 where that is this one.
    """

    def __init__(
        self,
        tracks: Mapping[str, Track],
        finish: Callable[[bool], None],
        trouble: Callable[[], str] = lambda: "",
        busy_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self.tracks = tracks
        self.trouble = trouble
        self.busy_s = busy_s
        self._finish = finish

    def __getitem__(self, stem: str) -> Track:
        return self.tracks[stem]

    @property
    def dropped(self) -> dict[str, int]:
        return {stem: track.dropped for stem, track in self.tracks.items()}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._finish(kind is None)
        except RecorderError:
            if error is None:
                raise


def record_here(folder: Path, layouts: Mapping[str, Layout]) -> Recording:
    """Write `folder/<stem>.arrow` for each stem from this process."""
    writers = {stem: BlockWriter(folder / f"{stem}.arrow", layout) for stem, layout in layouts.items()}

    def finish(well: bool) -> None:
        failed = ""
        for stem, writer in writers.items():
            try:
                writer.close() if well else writer.abandon()
            except (OSError, ValueError) as error:  # a disk that is full is full for every file: close all of them
                failed = failed or f"{folder / stem}.arrow: {_why(error)}"
        if failed:
            raise RecorderError(failed)

    return Recording(writers, finish)


def _why(error: Exception) -> str:
    """What an error of a file comes to, in a few words and one line."""
    words = os.strerror(error.errno).lower() if isinstance(error, OSError) and error.errno else str(error)
    return " ".join(words.split()) or "cannot be written"


def record_apart(
    folder: Path,
    layouts: Mapping[str, Layout],
    *,
    wait: bool = False,
    ring_rows: Mapping[str, int] = _NO_ROWS,
    shown: Callable[[Mapping[str, int]], None] | None = None,
) -> Recording:
    """Write `folder/<stem>.arrow` for each stem from a child process behind rings of `ring_rows[stem]` rows.

    Call it before the loop asks for real-time scheduling: the child is to run as an ordinary process. With
    `wait` (lockstep) a full ring holds the loop up instead of dropping rows. `shown` is given a descriptor of each
    ring, by stem, to be read only (`ring.Onlooker`), which is closed when it returns. Leaving the recording
    waits until the files are closed. Raises RecorderError when the child did not manage that, or could not begin.
    """
    names = {stem: f"{os.getpid()}-{time.monotonic_ns()}-{stem}" for stem in layouts}
    rings: dict[str, Ring] = {}
    try:
        for stem, layout in layouts.items():
            rings[stem] = Ring.create(names[stem], layout.dtype, ring_rows.get(stem, _RING_ROWS))
        child = _start_child(folder, layouts, names)
        if shown is not None:
            _show(rings, shown)
    finally:
        # both sides have them open by now: nothing is left behind in shared memory, however this ends
        for ring in rings.values():
            ring.unlink()
    if wait:
        for ring in rings.values():
            ring.while_full = lambda: child.poll() is None

    watch = _Watch(child, rings)

    def finish(well: bool) -> None:
        for ring in rings.values():
            if well:
                ring.finish()
        complaint = _end(child)
        watch.close()
        for ring in rings.values():
            ring.detach()
        if child.returncode:
            raise RecorderError(f"{folder}: {_ended(child.returncode, complaint)}")

    return Recording(rings, finish, watch.trouble, partial(_busy_s, child))


def _show(rings: Mapping[str, Ring], shown: Callable[[Mapping[str, int]], None]) -> None:
    with ExitStack() as open_files:
        descriptors = {}
        for stem, ring in rings.items():
            descriptors[stem] = os.open(ring.path, os.O_RDONLY)
            open_files.callback(os.close, descriptors[stem])
        shown(descriptors)


def _busy_s(child: subprocess.Popen[bytes]) -> float:
    """For how long, s, a child has had a processor; not a number once it has been waited for."""
    try:
        return time.clock_gettime((~child.pid << 3) | _OF_PROCESS)
    except OSError:
        return math.nan


class _Watch:
    """Whether the child that empties the rings still does."""

    def __init__(self, child: subprocess.Popen[bytes], rings: Mapping[str, Ring]) -> None:
        self._child = child
        self._rings = rings
        # Kept open: to read them takes microseconds, to open them tens.
        self._kernel = {name: _opened(f"/proc/{child.pid}/{name}") for name in ("stat", "schedstat")}
        self._read = dict.fromkeys(rings, 0)
        self._moved_s = dict.fromkeys(rings, time.monotonic())
        self._queued_s = dict.fromkeys(rings, self._queued())
        self._exiting_s: float | None = None

    def trouble(self) -> str:
        """Why nothing is recorded any more, "" if all is well."""
        if (code := self._child.poll()) is not None:
            assert self._child.stderr is not None
            return _ended(code, self._child.stderr.read())
        if fate := self._fate():
            return fate
        now_s, queued_s = time.monotonic(), self._queued()
        for stem, ring in self._rings.items():
            read, still_s = ring.read, now_s - self._moved_s[stem]
            if read != self._read[stem] or not ring.waiting:
                self._read[stem], self._moved_s[stem], self._queued_s[stem] = read, now_s, queued_s
            elif still_s > _STARVED_S or (
                still_s > _STUCK_S and still_s - (queued_s - self._queued_s[stem]) > _STUCK_S
            ):
                return f"the recorder is stuck: it has written nothing of {stem} for {still_s:.1f} s"
        return ""

    def close(self) -> None:
        for file in self._kernel.values():
            if file is not None:
                file.close()

    def _fate(self) -> str:
        """How the child ends, where its end has begun and it has no processor to come to it: on a busy machine it is
        the last to run, for that, too. By its row in proc(5): flags, and signals that wait for it.
        """
        fields = self._told("stat").rpartition(b")")[2].split()
        if len(fields) <= _PENDING:
            return ""
        if int(fields[_PENDING]) >> (signal.SIGKILL - 1) & 1:
            return _ended(-signal.SIGKILL, b"")
        if int(fields[_FLAGS]) & _EXITING:
            now_s = time.monotonic()
            if self._exiting_s is None:
                self._exiting_s = now_s  # with a processor it tells at once why
                with suppress(OSError):
                    os.sched_setscheduler(self._child.pid, os.SCHED_FIFO, os.sched_param(1))
            elif now_s - self._exiting_s > _DYING_S:
                return "the recorder has ended"
        return ""

    def _queued(self) -> float:
        """For how long, s, the child has been ready to run and had no processor; 0 where the kernel does not tell."""
        fields = self._told("schedstat").split()
        return 1e-9 * int(fields[1]) if len(fields) > 1 else 0.0

    def _told(self, name: str) -> bytes:
        """What the kernel says of the child, b"" where it says nothing."""
        file = self._kernel[name]
        try:
            return b"" if file is None else os.pread(file.fileno(), _ROW, 0)
        except OSError:  # it is gone
            return b""


def _opened(path: str) -> FileIO | None:
    try:
        return FileIO(path)
    except OSError:
        return None


def _ended(code: int, complaint: bytes) -> str:
    words = complaint.decode(errors="replace").strip().splitlines()
    if code < 0:
        return f"the recorder was killed by {signal.Signals(-code).name}"
    return f"the recorder failed: {words[-1][-300:]}" if words else f"the recorder ended with code {code}"


def _end(child: subprocess.Popen[bytes]) -> bytes:
    """Close its input, which is the word to end, and wait until the files are closed; what it complained of."""
    if child.poll() is None:
        child.send_signal(signal.SIGCONT)  # even where somebody stopped it: the rows that wait are worth more
        with suppress(OSError):  # nothing has to keep up with a clock any more: a busy machine is no reason to wait
            os.sched_setscheduler(child.pid, os.SCHED_OTHER, os.sched_param(0))
    try:
        return child.communicate(timeout=_CLOSING_S)[1]
    except subprocess.TimeoutExpired:
        child.kill()
        return child.communicate()[1]


def _start_child(folder: Path, layouts: Mapping[str, Layout], names: Mapping[str, str]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "hil.running.recording.recorder"]
    pipe = subprocess.PIPE
    # Who reads our line up to its end, after we were killed, has thereby waited for the files as well.
    output = os.dup(realtime.line())
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
        raise RecorderError(f"the recorder did not start: {_ended(child.returncode, complaint)}")
    return child


class _File:
    """A record file at the child's end: the ring that is emptied into it, and the pyramid that is written along, of
    what is drawn over time."""

    def __init__(self, name: str, path: str, layout: Layout) -> None:
        self.path = path
        self._ring = Ring.attach(name)
        self._writer = BlockWriter(Path(path), layout)
        self._pyramid = Pyramid(Path(path), layout) if layout.kind in KINDS else None

    def drain(self) -> None:
        """Write what waits. Raises OSError for the record; a pyramid that cannot be written is given up."""
        rows = self._ring.pop()
        self._writer.push(rows)
        if self._pyramid is not None:
            self._pyramid.push(rows)

    def close(self) -> None:
        """Write the rest, and end the record as the producer ended."""
        try:
            self.drain()
            self._writer.close() if self._ring.closed else self._writer.abandon()
        finally:
            self._well = self._ring.closed
            self._ring.detach()

    def close_pyramid(self) -> None:
        """End it: after all records, which are worth more."""
        if self._pyramid is not None:
            self._pyramid.close() if self._well else self._pyramid.abandon()


def serve() -> None:
    """The child: attach to the rings named on standard input, drain them until it closes, then end the
    files.
    """
    line = sys.stdin.buffer.readline()
    if not line.endswith(b"\n"):  # its parent has gone, as by an early Ctrl-C
        sys.exit(ExitCode.INTERRUPTED)
    order = json.loads(line)
    at = ""
    try:
        files = []
        for name, at, layout in order.values():
            files.append(_File(name, at, Layout.from_json(layout)))
        # What carries a pty's bytes is an ordinary kernel thread: a recorder in its way would make answers late.
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        print("ready", flush=True)
        hung_up = False
        while not hung_up:
            hung_up = bool(select.select([sys.stdin], [], [], _DRAIN_EVERY_S)[0])
            for file in files:
                at = file.path
                file.drain()
    except OSError as error:
        print(f"{at}: {_why(error)}", file=sys.stderr, flush=True)
        os._exit(ExitCode.BAD_INPUT)  # at once: the board is driven until this is seen; what is written is the kernel's
    failed = ""
    for file in files:
        try:
            file.close()
        except OSError as error:  # of one file: the others may have room
            failed = failed or f"{file.path}: {_why(error)}"
    for file in files:
        file.close_pyramid()
    if failed:
        print(failed, file=sys.stderr, flush=True)
        os._exit(ExitCode.BAD_INPUT)  # what could not be closed would only fail again, and say more


if __name__ == "__main__":
    serve()
