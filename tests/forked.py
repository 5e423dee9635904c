"""The process of a loop, or of an emulated board, as a fork of the one that tests run in.

A new interpreter that loads the estimator takes seconds of a processor, a fork none, and most tests of the loop are
about what it does and not about how it starts.  Those by the clock, and all that run `hil` as a command, start it as it
is.
"""

import gc
import inspect
import os
import signal
import subprocess
import sys
import traceback
import warnings
from collections.abc import Callable
from typing import Any

import device_emulator.__main__
from hil.loop import worker

_AS_GIVEN = inspect.signature(subprocess.Popen._execute_child)  # type: ignore[attr-defined]
_MAINS: dict[str, Callable[[list[str]], int]] = {
    "hil.loop.worker": lambda _: worker.main(),
    "device_emulator": device_emulator.__main__.main,
}


class Forked(subprocess.Popen[Any]):
    """A `subprocess.Popen` of `python … -m MODULE ARGUMENTS`: pipes, session and descriptors as asked for there."""

    def _execute_child(self, *given: Any) -> None:
        """In place of the standard library's, of which it takes the descriptors by name."""
        asked = _AS_GIVEN.bind(self, *given).arguments
        module = asked["args"].index("-m") + 1
        main, arguments = _MAINS[asked["args"][module]], asked["args"][module + 1 :]
        with warnings.catch_warnings():
            # From Python 3.12 on, of the thread by which xdist hears of its parent: it holds nothing needed here.
            warnings.simplefilter("ignore", DeprecationWarning)
            gc.disable()
            self.pid = os.fork()
        if self.pid == 0:
            # What the tests have left for the collector may hold numbers of descriptors that are the fork's own by now.
            gc.freeze()
            gc.enable()
            if asked["start_new_session"]:
                os.setsid()
            ours = [asked[name] for name in ("p2cread", "c2pwrite", "errwrite")]
            _run(lambda: main(arguments), ours, tuple(asked["pass_fds"]))
        gc.enable()
        self._child_created = True
        self._close_pipe_fds(*(asked[name] for name in _PIPES))  # type: ignore[attr-defined]


_PIPES = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")


def _run(main: Callable[[], int], given: list[int], kept: tuple[int, ...]) -> None:
    """In the fork; never returns.  given: descriptors for the first three, -1 for one that stays as it is."""
    code = 1
    try:
        for number, descriptor in enumerate(given):
            if descriptor >= 0:
                os.dup2(descriptor, number)
        last = 3
        for descriptor in sorted(kept):
            os.closerange(last, descriptor)
            os.set_inheritable(descriptor, True)
            last = descriptor + 1
        os.closerange(last, os.sysconf("SC_OPEN_MAX"))
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        sys.stdin = open(0, closefd=False)  # noqa: SIM115 - theirs as long as the process
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        code = main()
    except BaseException:  # noqa: BLE001 - whatever it is, a fork must not go on as what it is a fork of
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
