"""The loop's process as a fork of the one that tests run in.

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
from typing import Any

from hil.loop import worker

_AS_GIVEN = inspect.signature(subprocess.Popen._execute_child)  # type: ignore[attr-defined]


class Forked(subprocess.Popen[bytes]):
    """A `subprocess.Popen` of `python -m hil.loop.worker`: pipes, session and descriptors as asked for there."""

    def _execute_child(self, *given: Any) -> None:
        """In place of the standard library's, of which it takes the descriptors by name."""
        asked = _AS_GIVEN.bind(self, *given).arguments
        assert asked["args"][1:] == ["-m", "hil.loop.worker"]
        assert asked["start_new_session"]
        with warnings.catch_warnings():
            # From Python 3.12 on, of the thread by which xdist hears of its parent: it holds nothing needed here.
            warnings.simplefilter("ignore", DeprecationWarning)
            gc.disable()
            self.pid = os.fork()
        if self.pid == 0:
            # What the tests have left for the collector may hold numbers of descriptors that are the fork's own by now.
            gc.freeze()
            gc.enable()
            _as_the_worker(asked["p2cread"], asked["c2pwrite"], tuple(asked["pass_fds"]))
        gc.enable()
        self._child_created = True
        os.close(asked["p2cread"])
        os.close(asked["c2pwrite"])


def _as_the_worker(stdin: int, stdout: int, kept: tuple[int, ...]) -> None:
    """Never returns."""
    code = 1
    try:
        os.setsid()
        os.dup2(stdin, 0)
        os.dup2(stdout, 1)
        last = 3
        for descriptor in sorted(kept):
            os.closerange(last, descriptor)
            os.set_inheritable(descriptor, True)
            last = descriptor + 1
        os.closerange(last, os.sysconf("SC_OPEN_MAX"))
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.stdin = open(0, closefd=False)  # noqa: SIM115 - theirs as long as the process
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        code = worker.main()
    except BaseException:  # noqa: BLE001 - whatever it is, a fork must not go on as what it is a fork of
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
