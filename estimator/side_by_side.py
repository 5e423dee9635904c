"""Independent pieces of work side by side, on as many threads as there are processors: the kernels run without the
interpreter's lock.

What comes of it is what the pieces give one after another, to the last bit and in the order in which they were asked
for, whatever the number of workers: nothing may depend on who is first.  Threads live as long as the call that needs
them; a piece may call for others in turn, which get the workers that are free.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from estimator.errors import ModelError

Result = TypeVar("Result")
Other = TypeVar("Other")

WORKERS = "GYROHIL_WORKERS"
"""Environment variable: how many workers, where it should not be one for each processor."""

_MOST = 4
_PATIENCE_S = 0.2
"""So long an interrupted caller waits for its helpers, which are told between two portions of samples; one that is in a
long call by then ends with the process, or behind that call."""


class Abandoned(BaseException):
    """Nobody waits for this piece any more; no error, so that nothing takes it for one."""


def workers() -> int:
    """How many pieces run at a time: what the environment says, else the processors that this process may use, 4 at
    most.

    Raises ModelError where the environment says no whole number above 0.
    """
    told = os.environ.get(WORKERS, "")
    if not told:
        return min(len(os.sched_getaffinity(0)), _MOST)
    if not told.isdecimal() or int(told) < 1:
        raise ModelError(f"{WORKERS}={told}: no number of workers; give a whole number from 1 on, or leave it out")
    return int(told)


def one_worker_each() -> None:
    """For a caller that runs several processes side by side: they and those they start have one worker each."""
    os.environ[WORKERS] = "1"


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """For pieces side by side: they use the processors, and threads of BLAS beside them would wait for each other
    (a trace that way took five times as long).  Holds for the process, and ends with the block.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        yield


def side_by_side(
    pieces: Sequence[Callable[[], Result]], done: Callable[[int], None] = lambda finished: None
) -> list[Result]:
    """The results of all pieces, in their order; done: told, one call at a time, how many are finished.

    The error of a piece is raised, of several that of the first in order; those that were not begun by then are left
    out.  An interruption of the caller stops the others where they next ask (`stop_if_abandoned`).
    """
    return _result(_Batch(pieces, done, getattr(_now, "batch", None)), _Batch.work)


def interruptible(piece: Callable[[], Result]) -> Result:
    """The result of a piece that runs in a thread of its own while the caller waits.

    Ctrl-C reaches the main thread between two steps of the interpreter, and one call of a kernel may take seconds.
    """
    return _result(_Batch([piece], lambda finished: None, getattr(_now, "batch", None)), _Batch.hand_over)[0]


def _result(batch: "_Batch[Result]", begin: Callable[["_Batch[Result]"], None]) -> list[Result]:
    try:
        begin(batch)
        with _waiting():
            batch.join(_PATIENCE_S if batch.abandoned else None)
    except BaseException:
        batch.abandoned = True
        batch.join(_PATIENCE_S)
        raise
    return batch.outcome()


def together(one: Callable[[], Result], other: Callable[[], Other]) -> tuple[Result, Other]:
    """The results of two pieces of different kinds."""
    pieces: list[Callable[[], Any]] = [one, other]
    first, second = side_by_side(pieces)
    return first, second


def stop_if_abandoned() -> None:
    """To be called now and then in a long piece.

    Raises Abandoned where the caller has been interrupted.
    """
    batch: _Batch[Any] | None = getattr(_now, "batch", None)
    if batch is not None and batch.is_abandoned():
        raise Abandoned


_now = threading.local()
_lock = threading.Lock()
_busy = 0
"""Helpers at work in all of the process, less those who wait for one: the first caller is none and always there."""


def _recruit() -> bool:
    """Whether there is a worker to spare, who then is busy."""
    global _busy
    with _lock:
        found = _busy < workers() - 1
        _busy += found
    return found


def _release(number: int) -> None:
    global _busy
    with _lock:
        _busy -= number


@contextmanager
def _waiting() -> Iterator[None]:
    """Who waits for others makes room for one more."""
    _release(1)
    try:
        yield
    finally:
        _release(-1)


class _Batch(Generic[Result]):
    """Pieces that were asked for together."""

    def __init__(
        self, pieces: Sequence[Callable[[], Result]], done: Callable[[int], None], within: "_Batch[Any] | None"
    ) -> None:
        self.pieces, self.done, self.within = pieces, done, within
        self.abandoned = False
        self.results: dict[int, Result] = {}
        self.errors: dict[int, BaseException] = {}
        self.begun = 0
        self.lock = threading.Lock()
        self.helpers: list[threading.Thread] = []
        self.states = np.geterr()  # a thread begins with NumPy's own

    def is_abandoned(self) -> bool:
        """This one, or the one that it is a piece of."""
        return self.abandoned or (self.within is not None and self.within.is_abandoned())

    def work(self) -> None:
        """One piece after another, until none is left; errors are the caller's to raise."""
        outer = getattr(_now, "batch", None)
        _now.batch = self
        try:
            while (number := self._next()) is not None:
                with _Noted(self, number):
                    self._finish(number, self.pieces[number]())
        finally:
            _now.batch = outer

    def hand_over(self) -> None:
        """To a helper, in place of the caller."""
        _release(-1)
        self._call_helper()

    def join(self, seconds: float | None) -> None:
        """Wait for the helpers, so long for each."""
        for helper in self.helpers:
            helper.join(seconds)

    def _help(self) -> None:
        try:
            with np.errstate(**self.states):
                self.work()
        finally:
            _release(1)

    def outcome(self) -> list[Result]:
        """What came of it; an interruption goes before an error."""
        if self.errors:
            raise self.errors[min(self.errors, key=lambda n: (isinstance(self.errors[n], Exception), n))]
        if self.is_abandoned():
            raise Abandoned
        return [self.results[number] for number in range(len(self.pieces))]

    def _next(self) -> int | None:
        with self.lock:
            if self.errors or self.begun == len(self.pieces) or self.is_abandoned():
                return None
            self.begun += 1
            if self.begun < len(self.pieces) and _recruit():
                self._call_helper()
            return self.begun - 1

    def _call_helper(self) -> None:
        helper = threading.Thread(target=self._help, daemon=True)
        self.helpers.append(helper)
        helper.start()

    def _finish(self, number: int, result: Result) -> None:
        with self.lock:
            self.results[number] = result
            self.done(len(self.results))


class _Noted:
    """Keeps what a piece ends with, and lets nothing of it through: the caller of the batch shall hear of it first."""

    def __init__(self, batch: "_Batch[Any]", number: int) -> None:
        self.batch, self.number = batch, number

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> bool:
        if error is not None and not isinstance(error, Abandoned):
            self.batch.errors[self.number] = error
            if not isinstance(error, Exception):  # Ctrl-C: the others need not go on
                self.batch.abandoned = True
        return True
