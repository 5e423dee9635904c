"""A run that is looked at while it lasts: blocks of its record, as arrays, as they are written.

The loop runs in its own process and records as ever; a thread of this process follows it, and blocks are read from the
files.  So a slow reader holds nothing up.  Every way out ends the run well: the board is brought to
SAFE and has to confirm it, and the record is closed.
"""

import threading
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.library.keywords import in_arguments_of
from hil.library.loading import ANGLE, RATE, Run, chosen, of_capture, of_estimates, of_innovation
from hil.library.series import Series
from hil.progress import Watcher
from hil.records.blocks import Columns, GrowingFile, rows_of
from hil.records.capture import Capture
from hil.records.estimates import Estimates, Innovation
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest

_LOOK_S = 0.05  # between two looks at the files
_KINDS = ("capture", "estimates", "innovation")


@dataclass(frozen=True)
class Block:
    """What was recorded since the block before: rows of one stretch of bench time, none twice and none left out."""

    capture: Series
    """What was sensed and driven, every sample."""
    estimates: Series
    """States with their standard deviations, and of two axes the angle with all that belongs to it."""
    innovation: Series
    """Measured minus predicted voltage, every sample."""

    @cached_property
    def angle(self) -> Series:
        """As of a `Run`."""
        return chosen(self.estimates, ANGLE)

    @cached_property
    def rate(self) -> Series:
        """As of a `Run`."""
        return chosen(self.estimates, RATE)


class Live:
    """A run that begins with the first block of `stream()`, and ends with it.

    As a context manager it ends the run at the end of the `with`, whatever became of the iterator.
    """

    def __init__(self, request: RunRequest, out: Path, *, opened_by: Callable[..., Any], progress: Watcher) -> None:
        self._following = _Following(request, out, opened_by, progress)
        # Also where the iterator is kept somewhere and the interpreter ends.
        self._finalizer = weakref.finalize(self, self._following.end)
        self._streamed = False

    def stream(self) -> Iterator[Block]:
        """Its blocks as they are recorded; several times a second with most devices.

        Leaving the loop, by break, an exception or Ctrl-C, ends the run: SAFE, the record closed, figures and report
        made.  Raises InputError or WireError where no run could begin, InputError where it was streamed before.
        """
        if self._streamed:
            raise InputError("a run is streamed once; open another with hil.open")
        self._streamed = True
        following = self._following
        following.begin()
        try:
            yield from following.blocks()
        finally:
            following.end()
        following.require_begun()

    @property
    def run(self) -> Run:
        """The run, once it has ended.  Raises InputError before, and where nothing was recorded."""
        return self._following.run

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._following.end()


class _Following:
    """The thread that follows the loop's process, and what is known of the run."""

    def __init__(self, request: RunRequest, out: Path, opened_by: Callable[..., Any], progress: Watcher) -> None:
        self._request, self._out, self._opened_by, self._progress = request, out, opened_by, progress
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()
        self._folder: Path | None = None
        self._interrupt: Callable[[], None] | None = None
        self._ending = False
        self._error: BaseException | None = None

    def begin(self) -> None:
        """Start it."""
        self._thread = threading.Thread(target=self._follow, name="hil.open", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """End the run well, and wait for it; Ctrl-C meanwhile ends the loop's process at once, and its board is told
        SAFE from here.  May be called again, and where nothing began.
        """
        if self._thread is None:
            return
        self._ask()
        while self._thread.is_alive():
            try:
                self._thread.join()
            except KeyboardInterrupt:
                self._ask(again=True)

    def require_begun(self) -> None:
        """What went wrong, where something did."""
        if self._error is not None:
            raise self._error

    @property
    def run(self) -> Run:
        """The run that has ended."""
        if self._thread is None or self._thread.is_alive():
            raise InputError("the run has not ended yet")
        if self._folder is None or not self._folder.exists():
            self.require_begun()
            raise InputError("nothing was recorded: the run has no folder")
        return Run(RunFolder.open(self._folder))

    def blocks(self) -> Iterator[Block]:
        """Blocks of the files, until the run has ended and all was seen."""
        assert self._thread is not None
        files: dict[str, _Waiting] = {}
        try:
            while True:
                ended = not self._thread.is_alive()
                if not files and self._folder is not None:
                    files = _opened(self._folder)
                if files and self._folder is not None:
                    yield from _news(files, self._folder.name, last=ended)
                if ended:
                    return
                time.sleep(_LOOK_S)
        finally:
            for one in files.values():
                one.file.close()

    def _ask(self, *, again: bool = False) -> None:
        """Have the loop end, once, as soon as there is one."""
        with self._lock:
            act = self._interrupt if again or not self._ending else None
            self._ending = True
        if act is not None:
            act()

    def _begun(self, folder: Path, interrupt: Callable[[], None]) -> None:
        with self._lock:
            self._folder, self._interrupt = folder, interrupt
            ending = self._ending
        if ending:
            interrupt()

    def _follow(self) -> None:
        from hil.running.concluding import Interrupted
        from hil.running.run import run

        try:
            with in_arguments_of(self._opened_by):
                run(self._request, self._out, begun=self._begun, progress=self._progress)
        except Interrupted:  # asked for
            pass
        except BaseException as error:  # noqa: BLE001 - of a thread, and raised where the blocks are asked for
            self._error = error
        finally:
            self._interrupt = None


class _Waiting:
    """A growing file, and the rows of it that the others have not come to yet."""

    def __init__(self, file: GrowingFile) -> None:
        self.file = file
        self._rows: list[dict[str, npt.NDArray[Any]]] = []
        self._none: dict[str, npt.NDArray[Any]] = {}

    def look(self) -> None:
        """Take what is new."""
        new = self.file.news()
        read = {name: new[name] for name in new}
        self._none = self._none or {name: values[:0] for name, values in read.items()}
        if rows_of(new):
            self._rows.append(read)

    @property
    def oldest(self) -> int | None:
        """First tick there is."""
        return int(self._rows[0]["tick"][0]) if self._rows else None

    @property
    def newest(self) -> int | None:
        """Last tick there is."""
        return int(self._rows[-1]["tick"][-1]) if self._rows else None

    def until(self, tick: int) -> Columns:
        """The rows up to `tick`, which leave."""
        together = {
            name: np.concatenate([none, *(rows[name] for rows in self._rows)]) for name, none in self._none.items()
        }
        stop = int(np.searchsorted(together["tick"], tick, side="right"))
        rest = {name: values[stop:] for name, values in together.items()}
        self._rows = [rest] if len(rest["tick"]) else []
        return {name: values[:stop] for name, values in together.items()}


def _opened(folder: Path) -> dict[str, _Waiting]:
    """The files of a run that has begun to record, none before."""
    found: dict[str, _Waiting] = {}
    with suppress(InputError):  # not there, or its header is not
        for kind in _KINDS:
            found[kind] = _Waiting(GrowingFile(folder / f"{kind}.arrow", kind))
        return found
    for one in found.values():
        one.file.close()
    return {}


def _news(files: Mapping[str, _Waiting], run: str, *, last: bool) -> Iterator[Block]:
    """A block up to the tick that all files have come to, if any is new; after the end, up to that of each."""
    for one in files.values():
        one.look()
    last = last or all(one.file.complete for one in files.values())
    newest = [tick for one in files.values() if (tick := one.newest) is not None]
    if not newest or (len(newest) < len(files) and not last):
        return
    tick = max(newest) if last else min(newest)
    oldest = files["estimates"].oldest
    if not last and (oldest is None or oldest > tick):
        return
    columns = {kind: one.until(tick) for kind, one in files.items()}
    headers = {kind: one.file.header for kind, one in files.items()}
    yield Block(
        of_capture(Capture(columns["capture"], headers["capture"], complete=False), run),
        of_estimates(Estimates(columns["estimates"], headers["estimates"], complete=False), run),
        of_innovation(Innovation(columns["innovation"], headers["innovation"], complete=False), run),
    )
