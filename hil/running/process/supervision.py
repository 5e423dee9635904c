"""The loop's process from outside: started, followed line by line, told to end, and watched.

When it dies the board is left to its watchdog.  Then this process opens the link itself, tells the board to be SAFE
and says what it could confirm.
"""

import json
import os
import select
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from hil.bench import Bench
from hil.errors import InputError
from hil.progress import Progress, Watcher
from hil.running.process import line_workers
from hil.running.process.worker import Order
from hil.running.safety.latching import Safety, alarm_of
from hil.running.safety.stopping import bring_to_safe
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, LinkError, ProtocolError, WireError
from hil.wire.links import open_link
from hil.wire.messages import SafeReason

if TYPE_CHECKING:
    from hil.boards.emulation import Served

Begun = Callable[[Callable[[], None]], None]
Noticed = Callable[[str], None]
"""Told `stopping` as soon as a run is known to end early, then `safe` or `not confirmed` of its board."""
_ERRORS = {kind.__name__: kind for kind in (LinkClosed, LinkError, ProtocolError)}
_RECORD_S = 30.0  # for the recorder to end once the loop has died
_EMULATED_S = 2.0  # for a board that was started here to end with its host


@dataclass
class Ended:
    """How the loop's process ended.

    Attributes:
        outcome: what it says happened, or what is known without it; `safety` is always in it.
        interrupted: whether Ctrl-C came.
    """

    outcome: dict[str, Any] = field(default_factory=dict)
    interrupted: bool = False

    @property
    def safety(self) -> dict[str, Any]:
        safety: dict[str, Any] = self.outcome["safety"]
        return safety


def supervise(
    worker: "subprocess.Popen[bytes]",
    order: Order,
    progress: Watcher,
    board: "Served",
    begun: Begun | None = None,
    noticed: Noticed = lambda _: None,
) -> Ended:
    """Give the loop's process its order, against `board`, and follow it to its end.

    `begun` is told what has it end well, as Ctrl-C does, once it has started. Raises InputError or WireError with what
    it says when it could not begin, and what `progress` raises, after the process has ended.
    """
    assert worker.stdin is not None
    bench, link = order.request.bench, order.request.link
    in_time = nullcontext() if bench.loop.clock == "lockstep" else line_workers.ahead(link)
    confirm = partial(_confirm, link, bench, board)
    with closing(_Followed(worker, progress, confirm, noticed)) as followed, in_time, ctrl_c(followed.interrupt):
        with suppress(BrokenPipeError):  # it died before it read its order
            worker.stdin.write(order.line)
            worker.stdin.flush()
        try:
            if begun is not None:
                begun(followed.interrupt)
            followed.to_the_end()
        except BaseException:  # of a watcher: the board must not stay driven for that
            worker.terminate()
            followed.watched_by(lambda _: None)
            followed.to_the_end()
            raise
        worker.wait()
    if followed.error is not None:
        raise as_raised(*followed.error)
    ended = Ended(followed.outcome, followed.interrupted > 0)
    if not ended.outcome:
        code = worker.returncode
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
        fault = f"the loop failed, {followed.fault}"
        ended.outcome["stopped"] = followed.died or (fault if followed.fault else f"the loop's process {how}")
        if not followed.died and (named := plugins_named(bench)):
            ended.outcome["stopped"] += f", with {named} in it"
    ended.outcome.setdefault("safety", followed.safety if followed.safety is not None else Safety().told)
    return ended


def plugins_named(bench: Bench) -> str:
    """The plug-ins of a bench that are code, in words; "" where it has none."""
    from hil.plugins.finding import TABLE

    named = {"observer": bench.observer.plugin, "controller": bench.controller.plugin}
    return " and ".join(
        f"[{kind}] plugin {name.rpartition('/')[2]}"
        for kind, name in named.items()
        if name is not None and not name.endswith(TABLE)
    )


def as_raised(kinds: list[str], message: str) -> Exception:
    """An error of the loop's process by the names of its class and its bases, InputError where none is known here."""
    return next((_ERRORS[kind] for kind in kinds if kind in _ERRORS), InputError)(message)


class _Followed:
    """The process, and what it has said."""

    def __init__(
        self,
        worker: "subprocess.Popen[bytes]",
        progress: Watcher,
        confirm: Callable[[int], dict[str, Any]],
        noticed: Noticed,
    ) -> None:
        assert worker.stdout is not None
        self._worker = worker
        self._output = worker.stdout.fileno()
        self._progress = progress
        self._confirm = confirm
        self._noticed = noticed
        self._death = os.pidfd_open(worker.pid)  # before anything can have reaped it
        self._rest = b""
        self._armed: int | None = None  # unique id of the board
        self._until_s: float | None = None  # once it has died
        self.interrupted = 0
        self.outcome: dict[str, Any] = {}
        self.fault = ""
        self.died = ""  # a plug-in, and the process with it
        self.error: tuple[list[str], str] | None = None
        self.safety: dict[str, Any] | None = None

    def close(self) -> None:
        """Give back what its death is read from."""
        os.close(self._death)

    def watched_by(self, progress: Watcher) -> None:
        """Tell another one from now on."""
        self._progress = progress

    def interrupt(self) -> None:
        """Have it end well; the second time, have it end."""
        self.interrupted += 1
        self._worker.terminate() if self.interrupted == 1 else self._worker.kill()

    def to_the_end(self) -> None:
        """Read until it has ended and its recorder, which holds the pipe open as well, has closed the files."""
        while self._listen():
            pass

    def _listen(self) -> bool:
        watched = [self._output, *([self._death] if self._until_s is None else [])]
        left_s = None if self._until_s is None else max(self._until_s - time.monotonic(), 0.0)
        ready, _, _ = select.select(watched, (), (), left_s)
        if self._output in ready:
            data = os.read(self._output, 1 << 16)
            self._hear(data)
            if not data and self._until_s is None:  # its recorder was as quick to end
                select.select([self._death], (), (), _RECORD_S)
                self._died()
            return bool(data)
        if not ready:  # the recorder does not end; what it has written is there
            return False
        self._until_s = time.monotonic() + _RECORD_S
        self._died()  # the board is seen to before the record is
        return True

    def _died(self) -> None:
        """It has ended: a board that it left driven is told to be SAFE."""
        if self._armed is not None and self.safety is None and not self.outcome:
            self._noticed("stopping")
            self._stopped(self._confirm(self._armed))

    def _hear(self, data: bytes) -> None:
        *lines, self._rest = (self._rest + data).split(b"\n")
        for said in map(json.loads, lines):
            if "outcome" in said:
                self.outcome = said["outcome"]
            elif "error" in said:
                self.error = said["error"], said["message"]
            elif "fault" in said:
                self.fault = said["fault"]
            elif "died" in said:
                self.died = said["died"]
            elif "armed" in said:
                self._armed = said["board"]
            elif "stopping" in said:
                self._noticed("stopping")
            elif "safety" in said:
                self._stopped(said["safety"])
            else:
                self._progress(Progress(**said))

    def _stopped(self, safety: dict[str, Any]) -> None:
        """The board was told to be SAFE: where that was not confirmed, say so before anything else."""
        self.safety = safety
        self._noticed("safe" if safety.get("confirmed") else "not confirmed")
        if line := alarm_of(safety):
            self._progress(Progress("stop", 0, 0, alarm=line))


@contextmanager
def ctrl_c(act: Callable[[], None]) -> Iterator[None]:
    """Have `act` called on Ctrl-C and SIGTERM, between two steps of whatever goes on; in the main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: act()) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def _confirm(link: str, bench: Bench, board: "Served", unique_id: int) -> dict[str, Any]:
    """What this process can do for a board that the loop left driven: tell it to be SAFE, and listen.

    A link is found again by its name, which another board, or program, may have by then: what answers there has to be
    the board that was driven.
    """
    safety = Safety(armed=True)
    if link.startswith("inproc:"):
        safety.words = "the emulated board ended with the loop's process"
        return safety.told
    try:
        with closing(open_link(link)) as opened:
            endpoint = Endpoint(opened)
            stopped = bring_to_safe(
                endpoint, SafeReason.LINK_LOST, bench.link.timeout_s, rate_Hz=bench.device.sample_rate_Hz
            )
            safety.confirmed, safety.words = stopped.confirmed, stopped.why
            if stopped.status is not None:
                safety.confirmed_tick = stopped.status.tick
            if stopped.confirmed and (there := client.connect(endpoint).unique_id) != unique_id:
                safety.confirmed, safety.confirmed_tick = False, None
                safety.words = f"another board answers at {link}: {there:016x}, {unique_id:016x} was driven"
    except WireError as error:
        safety.confirmed, safety.words = False, f"the board cannot be reached any more: {error}"
    if not safety.confirmed and board.ends_within(_EMULATED_S):
        safety.confirmed, safety.words = None, "the emulated board has ended, and drives nothing"
    return safety.told
