"""The board at the end of a link, while nobody runs a loop with it and while somebody does.

A thread of its own does what takes time: it opens the link, asks the board now and then whether it is still there, and
runs the loop, which is in a process of its own again.  While the loop runs, nothing here touches the link.
"""

import queue
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil.bench import Bench
from hil.emulation import Served, is_emulated, served
from hil.errors import InputError, told_to_user
from hil.faults import fault_line
from hil.loop.live_settings import in_force
from hil.loop.stops import reason_name
from hil.progress import Progress
from hil.records.runfolder import RunFolder
from hil.service.board.messages import NOBODY
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import WireError
from hil.wire.links import open_link
from hil.wire.messages import Identity, SafeReason, State

_ASK_EVERY_S = 0.2
_PATIENCE_S = 0.35  # for an answer of a board that nobody drives
_CONNECT_S = 2.0
_OF_THE_LOOP = ("connect", "prepare", "run", "stop")  # stages while which its process has the link
_LEFT = "the run has ended, and the board has left: in lockstep it ends with its host"
_INSIST_S = 3.0  # after which a second SAFE ends the loop's process, whose board is then told SAFE from here

Told = Callable[[dict[str, Any]], None]
Answer = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Start:
    """What a run is to be."""

    bench: Bench
    out: Path
    open_loop: bool
    note: str | None
    control: socket.socket


class HeldBoard:
    """`told` is called with each change of the board's state, from whichever thread."""

    def __init__(self, told: Told) -> None:
        self._told = told
        self._jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._state: dict[str, Any] = dict(NOBODY)
        self._stack = ExitStack()
        self._board: Served | None = None
        self._endpoint: Endpoint | None = None
        self._link = ""
        self._running: threading.Thread | None = None
        self._interrupt: Callable[[], None] | None = None
        self._interrupted_s: float | None = None
        self._stop_early = False
        self._alarm = ""  # of the run: a SAFE that was not confirmed; it stays until the next start
        self._loop_has_link = False
        self._leaves = False  # as a board in lockstep may, when its host has ended
        self._starting: Answer = _nobody
        self._ended = False
        self._thread = threading.Thread(target=self._work, name="board")
        self._thread.start()

    # -- what is asked, from the main thread ---------------------------------------------------------------------------

    @property
    def state(self) -> dict[str, Any]:
        """A copy of what is known."""
        with self._lock:
            return dict(self._state)

    @property
    def busy(self) -> bool:
        """Whether a run is under way, its report included."""
        return self._running is not None and self._running.is_alive()

    def connect(self, link: str, answer: Answer) -> None:
        """Open `link`, look at the board; nothing is armed."""
        self._jobs.put(lambda: self._answered(answer, lambda: self._connect(link)))

    def disconnect(self, answer: Answer) -> None:
        """Let the link go; a board that was started for it ends."""
        self._jobs.put(lambda: self._answered(answer, self._disconnect))

    def start(self, start: Start, answer: Answer) -> None:
        """Begin a run; the answer comes when the loop's process has begun, or could not."""
        self._jobs.put(lambda: self._start(start, answer))

    def safe(self, answer: Answer) -> None:
        """SAFE, now: the loop is told by a signal, a board without one from here. While a loop runs the answer says
        only that it was told; what the board says to it comes over the loop's own line.
        """
        if not self._tell_loop():
            self._jobs.put(lambda: self._answered(answer, self._safe))
            return
        answer({"said": {"told": True, "loop": True}})

    def armed(self) -> None:
        """The loop says that the board is armed; how far the run is comes another way, and may have come first."""
        self._change(state="RUNNING" if self.state["stage"] == "run" else "ARMED", reason="")
        self._begun({"said": {"run": self.state["run"]}})

    def changed(self, settings: dict[str, float]) -> None:
        """The loop says what is in force."""
        self._change(settings=settings)

    def answered_safe(self, safe: dict[str, Any]) -> None:
        """The loop says that the board has said that it is SAFE."""
        self._change(state="SAFE", reason=safe["reason"], safe_tick=safe["tick"])

    def end(self) -> None:
        """Let the link go, once no run is under way; waits for it."""
        if self._running is not None:
            self._running.join()
        self._jobs.put(self._end)
        self._thread.join()

    def _tell_loop(self) -> bool:
        """Have the loop bring its board to SAFE, if there is one."""
        if not self._loop_has_link:
            return False
        self._stop_early = True
        now = time.monotonic()
        interrupt = self._interrupt
        if interrupt is not None and (self._interrupted_s is None or now - self._interrupted_s > _INSIST_S):
            self._interrupted_s = now
            interrupt()
        return True

    def _begun(self, answer: dict[str, Any]) -> None:
        """Answer whoever asked for the start, once."""
        with self._lock:
            starting, self._starting = self._starting, _nobody
        starting(answer)

    # -- the board's own thread ----------------------------------------------------------------------------------------

    def _work(self) -> None:
        while not self._ended:
            try:
                self._jobs.get(timeout=_ASK_EVERY_S)()
            except queue.Empty:
                self._see_to_it()

    def _end(self) -> None:
        self._disconnect()
        self._ended = True

    def _answered(self, answer: Answer, work: Callable[[], dict[str, Any]]) -> None:
        try:
            said = work()
        except (InputError, WireError, OSError) as error:
            answer({"refused": told_to_user(error) or str(error)})
        else:
            answer({"said": said})

    def _connect(self, link: str) -> dict[str, Any]:
        if self.busy:
            raise InputError("a run is under way; stop it first")
        self._disconnect()
        self._change(link=link, emulated=is_emulated(link), words="connecting")
        try:
            if link.startswith("inproc:"):
                open_link(link).close()
                self._board, identity = Served(link), None
            else:
                self._board = self._stack.enter_context(
                    served(link, progress=lambda told: self._change(words=told.note))
                )
                endpoint = self._open(self._board.url)
                identity = client.connect(endpoint, _CONNECT_S)
                self._ask(endpoint)
        except BaseException:
            self._disconnect()
            raise
        self._link = link
        self._leaves = False
        self._change(connected=True, lost=False, left=False, words="", identity=_told_identity(identity))
        if identity is None:
            self._change(state="IDLE", reason="")
        return self.state

    def _disconnect(self) -> dict[str, Any]:
        if self.busy:
            raise InputError("a run is under way; stop it first")
        self._close()
        self._board, self._link = None, ""
        with suppress(InputError):  # of a board that died meanwhile
            self._stack.close()
        self._stack = ExitStack()
        self._change(**NOBODY)
        return self.state

    def _open(self, url: str) -> Endpoint:
        self._endpoint = Endpoint(open_link(url))
        return self._endpoint

    def _close(self) -> None:
        if self._endpoint is not None:
            with suppress(WireError, OSError):
                self._endpoint.close()
            self._endpoint = None

    def _see_to_it(self) -> None:
        """Whether the board is still there, unless a loop sees to that."""
        if not self._link or self._loop_has_link or self._link.startswith("inproc:"):
            return
        try:
            if self._endpoint is None:
                self._ask(self._opened_again())
                self._leaves = False
                self._change(lost=False, left=False, words="")
            else:
                self._ask(self._endpoint)
        except (InputError, WireError, OSError) as error:
            self._close()
            self._miss(_LEFT if self._leaves else told_to_user(error) or str(error))

    def _miss(self, words: str) -> None:
        """The board does not answer; say why."""
        if not self.state["lost"] or self.state["words"] != words:
            self._change(lost=True, left=self._leaves, state="LOST", reason="", words=words)

    def _opened_again(self) -> Endpoint:
        """The link once more, without a HELLO where that can be: it would lift a latch that nobody has looked at."""
        assert self._board is not None
        if self._board.board is not None and self._board.board.process.poll() is not None:
            if self._leaves:
                self._miss(f"{_LEFT}; the emulated one is started anew")
            with suppress(InputError):
                self._stack.close()
            self._stack = ExitStack()
            self._board = self._stack.enter_context(served(self._link))
            endpoint = self._open(self._board.url)
            client.connect(endpoint, _CONNECT_S)
            return endpoint
        endpoint = self._open(self._board.url)
        if self._link.startswith("udp:"):  # where a session begins with it
            client.connect(endpoint, _PATIENCE_S)
        return endpoint

    def _ask(self, endpoint: Endpoint) -> None:
        """SAFE for a reason that covers no other: the board says where it is and why, and stays there."""
        self._heard(client.make_safe(endpoint, SafeReason.LINK_LOST, _PATIENCE_S))

    def _safe(self) -> dict[str, Any]:
        if self._tell_loop():  # it began meanwhile
            return {"told": True, "loop": True}
        if self._link.startswith("inproc:") or not self._link:
            return {"state": self.state["state"], "told": False}
        endpoint = self._endpoint or self._opened_again()
        status = client.make_safe(endpoint, SafeReason.HOST_REQUEST, _CONNECT_S)
        self._heard(status)
        return {"state": "SAFE", "told": True, "tick": status.tick, "reason": reason_name(status.reason)}

    def _heard(self, status: Any) -> None:
        state = next((member.name for member in State if member == status.state), str(status.state))
        reason = reason_name(status.reason)
        if (state, reason) != (self.state["state"], self.state["reason"]):
            self._change(state=state, reason=reason)

    # -- a run ---------------------------------------------------------------------------------------------------------

    def _start(self, start: Start, answer: Answer) -> None:
        if not self._link or self.busy:
            start.control.close()
            answer({"refused": "a run is under way" if self.busy else "no board is connected"})
            return
        self._close()
        self._stop_early, self._interrupted_s, self._starting, self._alarm = False, None, answer, ""
        self._loop_has_link = True
        self._leaves = start.bench.loop.clock == "lockstep"
        self._change(
            stage="connect",
            done=0,
            total=0,
            words="",
            settings=in_force(start.bench),
            bench=start.bench.loop.name,
            duration_s=start.bench.loop.duration_s,
            safe_tick=None,
        )
        self._running = threading.Thread(target=self._run, args=(start,), name="run")
        self._running.start()

    def _run(self, start: Start) -> None:
        from hil.loop.run import Interrupted, run

        outcome: dict[str, Any] = {"run": None, "words": ""}

        def begun(folder: Path, interrupt: Callable[[], None]) -> None:
            outcome["run"] = folder.name
            self._change(run=folder.name)
            self._interrupt = interrupt
            if self._stop_early and self._interrupted_s is None:
                self._tell_loop()

        try:
            done = run(
                start.bench,
                self._link,
                start.out,
                open_loop=start.open_loop,
                note=start.note,
                begun=begun,
                board=self._board,
                control=start.control,
                progress=self._progress,
            )
            if done.folder is not None:
                result = RunFolder(done.folder).result
                outcome["words"] = "" if result is None or result.verdict == "good" else next(iter(result.reasons), "")
        except Interrupted as interrupted:
            outcome["words"] = str(interrupted)
        except Exception as error:  # noqa: BLE001 - of a thread: it is told, and the board is seen to either way
            words = told_to_user(error) or fault_line(error)
            outcome["words"] = words
        finally:
            self._interrupt = None
            self._loop_has_link = False
            kept = outcome["run"] is not None and (start.out / outcome["run"]).exists()
            outcome["run"] = outcome["run"] if kept else None
            outcome["words"] = self._alarm or outcome["words"]
            start.control.close()
            self._change(run=None, stage="", words=outcome["words"], settings={}, last_run=outcome["run"])
            self._begun({"said": outcome} if kept else {"refused": outcome["words"]})
            self._told({"run": outcome["run"], "words": outcome["words"]})

    def _progress(self, progress: Progress) -> None:
        before = self.state
        self._alarm = self._alarm or progress.alarm
        if progress.stage == "run" and before["state"] == "ARMED":
            self._change(state="RUNNING")
        elif progress.stage == "run" and progress.done and before["state"] == "SAFE" and before["safe_tick"] is None:
            self.armed()  # samples are answered, and the line that says so has not: it may lose what it has no room for
        if progress.stage not in _OF_THE_LOOP:
            self._interrupt = None
            self._loop_has_link = False
        self._change(
            stage=progress.stage,
            done=progress.done,
            total=progress.total,
            words=self._alarm or progress.note or (before["words"] if before["stage"] == progress.stage else ""),
        )

    def _change(self, **what: Any) -> None:
        with self._lock:
            self._state |= what
            state = dict(self._state)
        self._told({"board": state})


def _told_identity(identity: Identity | None) -> dict[str, Any] | None:
    if identity is None:
        return None
    return {**identity._asdict(), "serial": f"{identity.unique_id:016x}"}


def _nobody(_: dict[str, Any]) -> None:
    """Who asked has been answered."""
