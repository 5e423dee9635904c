"""The board at the end of a link, while nobody runs a loop with it and while somebody does.

A thread of its own asks the board now and then whether it is still there, and runs the loop; whatever may hang is in a
process of its own, with a limit: the opening of a link, what is said on it, the loop.  So SAFE and disconnect never
wait for it.  While the loop runs, nothing here touches the link.
"""

import logging
import queue
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hil.boards.emulation import Served
from hil.errors import InputError
from hil.errors.ending import line_of
from hil.progress import Progress
from hil.records.runfolder import RunFolder
from hil.running.process.live_settings import in_force
from hil.running.request import RunRequest
from hil.running.safety.latching import reason_name
from hil.service.board.link_process import LinkProcess
from hil.service.board.messages import NOBODY
from hil.service.board.opening import PATIENCE_S, Opening
from hil.wire.errors import LinkError, WireError
from hil.wire.link_name import Emulated, LinkName
from hil.wire.messages import SafeReason, State

_LOG = logging.getLogger("hil.service")
_ASK_EVERY_S = 0.2
_SAFE_S = 0.6  # for a board without a loop to say that it is SAFE
_OWED_S = 0.6  # for a link to be there again, through which SAFE can be said
_OF_THE_LOOP = ("connect", "prepare", "run", "stop")  # stages while which its process has the link
_LEFT = "the run has ended, and the board has left: in lockstep it ends with its host"
_INSIST_S = 3.0  # after which a second SAFE ends the loop's process, whose board is then told SAFE from here

Told = Callable[[dict[str, Any]], None]
Answer = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Start:
    """What a run is to be."""

    request: RunRequest
    out: Path
    control: socket.socket
    bench: str


class HeldBoard:
    """`told` is called with each change of the board's state, from whichever thread."""

    def __init__(self, told: Told) -> None:
        self._told = told
        self._jobs: queue.SimpleQueue[tuple[Callable[[], None], Answer]] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._state: dict[str, Any] = dict(NOBODY)
        self._stack = ExitStack()
        self._board: Served | None = None
        self._held: LinkProcess | None = None
        self._link: LinkName | None = None
        self._opening: Opening | None = None
        self._connecting: Answer | None = None  # who asked for the opening that is under way
        self._again_s = 0.0  # when a link that was lost is tried again
        self._owed: list[tuple[Answer, float]] = []  # SAFEs that wait for the link, and until when
        self._after: list[Callable[[], None]] = []  # what waits for the opening to come to its end
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
        with self._lock:
            return dict(self._state)

    @property
    def busy(self) -> bool:
        """Whether a run is under way, its report included."""
        return self._running is not None and self._running.is_alive()

    def connect(self, link: LinkName, answer: Answer, bench: str | None = None) -> None:
        """Open `link`, look at the board; nothing is armed. `bench`: the file that was named for it."""
        self._jobs.put((lambda: self._connect(link, answer, bench), answer))

    def disconnect(self, answer: Answer) -> None:
        """Let the link go, or give up its opening; a board that was started for it ends."""
        self._jobs.put((lambda: answer({"said": self._disconnect()}), answer))

    def start(self, start: Start, answer: Answer) -> None:
        """Begin a run; the answer comes when the loop's process has begun, or could not."""
        self._jobs.put((lambda: self._start(start, answer), answer))

    def safe(self, answer: Answer) -> None:
        """SAFE, now: the loop is told by a signal, a board without one from here. While a loop runs the answer says
        only that it was told; what the board says to it comes over the loop's own line.
        """
        if not self._tell_loop():
            self._jobs.put((lambda: self._safe(answer), answer))
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
        self._jobs.put((self._end, _nobody))
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
        """Answer the request for the start, once."""
        with self._lock:
            starting, self._starting = self._starting, _nobody
        starting(answer)

    # -- the board's own thread ----------------------------------------------------------------------------------------

    def _work(self) -> None:
        while not self._ended:
            try:
                work, answer = self._jobs.get(timeout=_ASK_EVERY_S)
            except queue.Empty:
                work, answer = self._see_to_it, _nobody
            try:
                work()
            except (InputError, WireError, OSError) as error:
                answer({"refused": line_of(error)})
            except Exception as error:  # noqa: BLE001 - what comes next may be SAFE, for which this thread must be there
                _LOG.exception("the thread that holds the board")
                answer({"refused": line_of(error)})

    def _end(self) -> None:
        try:
            self._disconnect()
        finally:
            self._ended = True

    def _connect(self, link: LinkName, answer: Answer, bench: str | None) -> None:
        if self.busy:
            answer({"refused": "a run is under way; stop it first"})
            return
        self._disconnect()
        self._change(link=link.url, emulated=isinstance(link, Emulated), words="connecting", bench=bench)
        self._connecting = answer
        self._open(link, None, greet=True)

    def _open(self, link: LinkName, board: Served | None, *, greet: bool) -> None:
        """Begin to open the link; `_opened` is called when that has come to its end."""
        reason = SafeReason.HOST_REQUEST if self._owed else SafeReason.LINK_LOST
        self._opening = Opening(
            link, board, greet=greet, reason=reason, done=self._put_opened,
            told=lambda words: self._change(words=words),
        )  # fmt: skip

    def _put_opened(self, opening: Opening) -> None:
        self._jobs.put((lambda: self._opened(opening), self._connecting or _nobody))

    def _opened(self, opening: Opening) -> None:
        if opening is not self._opening:  # given up meanwhile
            opening.close()
            return
        self._opening = None
        self._again_s = time.monotonic() + _ASK_EVERY_S
        connecting, self._connecting = self._connecting, None
        if opening.board is not None and not opening.resumed:  # whatever became of its link
            self._board, self._stack = opening.board, opening.stack
        if opening.error:
            if connecting is None:
                self._miss(_LEFT if self._leaves else opening.error)
            else:
                self._disconnect()
                connecting({"refused": opening.error})
            self._go_on()
            return
        self._held, self._link = opening.process, opening.link
        self._leaves = False
        known = {} if opening.identity is None else {"identity": _told_identity(opening.identity)}
        self._change(connected=True, lost=False, left=False, words="", **known)
        if opening.status is None:
            self._change(state="IDLE", reason="")
        else:
            self._heard(opening.status)
            self._settle(opening)
        if connecting is not None:
            connecting({"said": self.state})
        self._go_on()

    def _settle(self, opening: Opening) -> None:
        """Answer the SAFEs that waited for the link; those asked for while it was opened are said now."""
        owed, self._owed = self._owed, []
        for answer, _ in owed:
            if opening.reason is SafeReason.HOST_REQUEST and opening.status is not None:
                answer({"said": _told_safe(opening.status)})
            else:
                self._safe(answer)

    def _go_on(self) -> None:
        """What waited for the link's opening, whatever came of it."""
        after, self._after = self._after, []
        for act in after:
            act()

    def _disconnect(self) -> dict[str, Any]:
        if self.busy:
            raise InputError("a run is under way; stop it first")
        if self._opening is not None:
            self._opening.give_up()
            self._opening = None
        if self._connecting is not None:
            connecting, self._connecting = self._connecting, None
            connecting({"refused": "given up: the board was disconnected meanwhile"})
        self._close()
        self._link = None
        self._end_board()
        self._change(**NOBODY)
        self._refuse_owed("no board is connected")
        self._go_on()
        return self.state

    def _end_board(self) -> None:
        """Have the board end that was started here."""
        self._board = None
        with suppress(InputError):  # of a board that died meanwhile
            self._stack.close()
        self._stack = ExitStack()

    def _close(self) -> None:
        if self._held is not None:
            self._held.close()
            self._held = None

    def _see_to_it(self) -> None:
        """Whether the board is still there, unless a loop sees to that."""
        if any(time.monotonic() > until for _, until in self._owed):
            self._refuse_owed(f"the board cannot be told: {self.state['words'] or 'its link is being opened'}")
        if self._link is None or self._loop_has_link or self._opening is not None or self._in_process:
            return
        if self._held is None:
            if time.monotonic() >= self._again_s:
                self._open_again()
            return
        try:
            self._heard(self._held.safe(SafeReason.LINK_LOST, PATIENCE_S))
        except LinkError as error:
            self._close()
            self._miss(_LEFT if self._leaves else str(error))

    @property
    def _in_process(self) -> bool:
        return isinstance(self._link, Emulated) and self._link.kind == "inproc"

    def _miss(self, words: str) -> None:
        """The board does not answer; say why."""
        if not self.state["lost"] or self.state["words"] != words:
            self._change(lost=True, left=self._leaves, state="LOST", reason="", words=words)

    def _open_again(self) -> None:
        """The link once more, without a HELLO where that can be: it would lift a latch that nobody has looked at."""
        assert self._link is not None
        if self._board is not None and (self._board.board is None or self._board.board.process.poll() is None):
            self._open(self._link, self._board, greet=False)
            return
        if self._leaves:
            self._miss(f"{_LEFT}; the emulated one is started anew")
        self._end_board()
        self._open(self._link, None, greet=True)

    def _safe(self, answer: Answer) -> None:
        """SAFE to a board without a loop; answered within a second, whatever the link does."""
        if self._tell_loop():  # it began meanwhile
            answer({"said": {"told": True, "loop": True}})
        elif self._in_process or self._link is None:
            answer({"said": {"state": self.state["state"], "told": False, "words": "no board is connected"}})
        elif self._held is None:
            self._owed.append((answer, time.monotonic() + _OWED_S))
            if self._opening is None:
                self._open_again()
        else:
            try:
                status = self._held.safe(SafeReason.HOST_REQUEST, _SAFE_S)
            except LinkError as error:
                self._close()
                self._miss(str(error))
                answer({"said": _untold(str(error))})
            else:
                self._heard(status)
                answer({"said": _told_safe(status)})

    def _refuse_owed(self, words: str) -> None:
        owed, self._owed = self._owed, []
        for answer, _ in owed:
            answer({"said": _untold(words)})

    def _heard(self, status: dict[str, Any]) -> None:
        state = next((member.name for member in State if member == status["state"]), str(status["state"]))
        reason = reason_name(status["reason"])
        if (state, reason) != (self.state["state"], self.state["reason"]):
            self._change(state=state, reason=reason)

    # -- a run ---------------------------------------------------------------------------------------------------------

    def _start(self, start: Start, answer: Answer) -> None:
        if self._opening is not None and self._connecting is None:
            self._after.append(lambda: self._start(start, answer))
            return
        if self._link is None or self.busy:
            start.control.close()
            under_way = "a run is under way; stop it, or wait for its end"
            answer({"refused": under_way if self.busy else "no board is connected; connect one"})
            return
        self._close()
        if start.request.own_board and not self._in_process:
            self._end_board()  # the run starts one of its own
        self._stop_early, self._interrupted_s, self._starting, self._alarm = False, None, answer, ""
        self._loop_has_link = True
        self._leaves = start.request.bench.loop.clock == "lockstep"
        self._change(
            stage="connect",
            done=0,
            total=0,
            words="",
            settings=in_force(start.request.bench),
            bench=start.bench,
            duration_s=start.request.bench.loop.duration_s,
            safe_tick=None,
        )
        self._running = threading.Thread(target=self._run, args=(start,), name="run")
        self._running.start()

    def _run(self, start: Start) -> None:
        from hil.running.concluding import Interrupted
        from hil.running.run import run

        link = self._link
        assert link is not None
        outcome: dict[str, Any] = {"run": None, "words": ""}

        def begun(folder: Path, interrupt: Callable[[], None]) -> None:
            outcome["run"] = folder.name
            self._change(run=folder.name)
            self._interrupt = interrupt
            if self._stop_early and self._interrupted_s is None:
                self._tell_loop()

        try:
            done = run(
                replace(start.request, link=link.url), start.out,
                begun=begun, board=self._board, control=start.control, progress=self._progress,
            )  # fmt: skip
            if done.folder is not None:
                result = RunFolder(done.folder).result
                if result is not None:
                    outcome["verdict"] = {"verdict": result.verdict, "against": result.against}
                    outcome["words"] = "" if result.verdict == "good" else next(iter(result.reasons), "")
        except Interrupted as interrupted:
            outcome["words"] = str(interrupted)
        except Exception as error:  # noqa: BLE001 - of a thread: it is told, and the board is seen to either way
            outcome["words"] = line_of(error)
        finally:
            self._interrupt = None
            self._loop_has_link = False
            kept = outcome["run"] is not None and (start.out / outcome["run"]).exists()
            outcome["run"] = outcome["run"] if kept else None
            outcome["words"] = self._alarm or outcome["words"]
            start.control.close()
            self._change(
                run=None,
                stage="",
                words=outcome["words"],
                settings={},
                last_run=outcome["run"],
                last_verdict=outcome.pop("verdict", None),
            )
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


def _told_identity(identity: dict[str, Any]) -> dict[str, Any]:
    return {**identity, "serial": f"{identity['unique_id']:016x}"}


def _told_safe(status: dict[str, Any]) -> dict[str, Any]:
    """What a SAFE is answered with that the board has answered."""
    return {"state": "SAFE", "told": True, "tick": status["tick"], "reason": reason_name(status["reason"])}


def _untold(words: str) -> dict[str, Any]:
    """What a SAFE is answered with that no board has answered."""
    return {"state": "LOST", "told": True, "unanswered": True, "words": words}


def _nobody(_: dict[str, Any]) -> None:
    """Who asked has been answered."""
