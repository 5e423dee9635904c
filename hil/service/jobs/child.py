"""The process of a job: does what is in `order.json` of its folder, and leaves `outcome.json` there.

It tells how far it is on standard output, a JSON object a line. It ends well when `cancel` comes on standard input, and
when that is closed, because the service has gone: so no job outlives its service unseen.
"""

import json
import math
import os
import signal
import sys
import threading
import time
import traceback
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

from hil.errors.ending import ExitCode, ending_of
from hil.errors.interruption import interrupt
from hil.progress import Progress
from hil.records.atomic import occupied, write_text

ORDER, OUTCOME = "order.json", "outcome.json"
CANCELLED = "cancelled"
ORPHANED = "the service ended before it was done"
_EVERY_S = 0.1
_NICE = 10


class _Ending:
    """Whether and why the job is to end, by what comes on standard input."""

    def __init__(self) -> None:
        self.why = ""
        self.done = threading.Event()

    def wait(self) -> None:
        """Wait for it, then interrupt the main thread as Ctrl-C does."""
        line = sys.stdin.readline()
        if not self.done.is_set():
            self.why = CANCELLED if line.strip() == "cancel" else ORPHANED
            os.kill(os.getpid(), signal.SIGINT)


class _Told:
    """Says how far the job is, a few times a second."""

    def __init__(self) -> None:
        self._stage, self._last_s = "", 0.0
        self._from_s, self._from = 0.0, 0  # when the stage was first heard of, and how far it was then

    def __call__(self, progress: Progress) -> None:
        now_s = time.monotonic()
        if progress.stage != self._stage:
            self._stage, self._from_s, self._from = progress.stage, now_s, progress.done
        elif now_s - self._last_s < _EVERY_S and not progress.alarm:
            return
        self._last_s = now_s
        left_s = progress.left_s
        if left_s is None and self._from < progress.done <= progress.total:
            left_s = (now_s - self._from_s) * (progress.total - progress.done) / (progress.done - self._from)
        if left_s is not None and not math.isfinite(left_s):
            left_s = None
        self.say(
            stage=progress.stage, done=progress.done, total=progress.total, note=progress.note, alarm=progress.alarm,
            left_s=left_s,
        )  # fmt: skip

    def say(self, **told: Any) -> None:
        """One line; nobody has to listen."""
        with suppress(BrokenPipeError, ValueError):
            print(json.dumps(told), flush=True)


def main(place: Path) -> None:
    signal.signal(signal.SIGINT, _interrupt)
    ending, told = _Ending(), _Told()
    threading.Thread(target=ending.wait, name="ending", daemon=True).start()
    outcome: dict[str, Any] = {"state": "failed", "error": None, "result": {}, "began": time.time()}
    called: dict[str, str] = {}
    code = ExitCode.INTERRUPTED

    def began(run: str) -> None:
        outcome["result"] = {"run": run}
        told.say(run=run)

    with occupied(place):
        try:
            os.nice(_NICE)
            order = json.loads((place / ORDER).read_text())
            called = order["do"].get("called", {})
            if order["do"]["kind"] == "import":
                from hil.service.jobs.limits import limit_this_process

                limit_this_process()
            from hil.service.jobs.work import do

            outcome["result"] = do(order["do"], Path(order["out"]), place, began=began, progress=told)
            outcome["state"], code = "done", ExitCode.GOOD
        except KeyboardInterrupt as interruption:
            words = "; ".join(one for one in (ending.why or "interrupted", str(interruption)) if one)
            outcome |= {"state": "cancelled" if ending.why == CANCELLED else "failed", "error": words}
        except Exception as error:  # noqa: BLE001 - whatever it was, the job has an outcome that says so
            failed = ending_of(error)
            outcome["error"], code = _as_asked(failed.line, called), failed.code
            traceback.print_exc()
        if (run := outcome["result"].get("run")) and not (Path(order["out"]) / run).is_dir():
            outcome["result"] = {}  # it had begun, and left nothing
        ending.done.set()
        write_text(place / OUTCOME, json.dumps({**outcome, "ended": time.time()}) + "\n")
    sys.stdout.flush()
    os._exit(code)  # what a library leaves running has nothing to say any more


def _as_asked(error: str, called: dict[str, str]) -> str:
    """An error that calls files as who asked calls them: an upload's path here says nothing to its sender."""
    for path in sorted(called, key=len, reverse=True):
        error = error.replace(path, called[path])
    return error


def _interrupt(number: int, frame: FrameType | None) -> None:
    try:
        interrupt(number, frame)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # once: what follows ends well undisturbed
        raise


if __name__ == "__main__":
    main(Path(sys.argv[1]))
