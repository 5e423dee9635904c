"""A process of ours as a fork of the one that tests run in: a loop, an emulated board, a report's figures, a service,
a job.

A new interpreter that loads the estimator or the service takes seconds of a processor, a fork none, and most tests are
about what such a process does and not about how it starts.  Those by the clock, and those that signal `hil` as a
command, start it as it is.
"""

import gc
import importlib
import inspect
import os
import signal
import subprocess
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

_FOLDERS = os.environ.get("PYTHONPATH", "").split(os.pathsep)
_AS_GIVEN = inspect.signature(subprocess.Popen._execute_child)  # type: ignore[attr-defined]
_MAINS: dict[str, tuple[str, Callable[[Any, list[str]], int]]] = {
    "device_emulator": ("device_emulator.__main__", lambda emulator, arguments: emulator.main(arguments)),
    "hil": ("hil.service.serve", lambda _, arguments: _command(arguments)),
    "hil.running.recording.recorder": ("hil.running.recording.recorder", lambda recorder, _: recorder.serve() or 0),
    "hil.report.artist": ("matplotlib.backends.backend_svg", lambda *_: _artist()),
    "hil.running.process.worker": ("hil.running.process.worker", lambda worker, _: worker.main()),
    "hil.service.board.keeper": ("hil.service.board.keeper", lambda keeper, arguments: _keeper(keeper, arguments)),
    "hil.service.board.link_process": ("hil.service.board.link_process", lambda process, _: process.main()),
    "hil.sweeping.child": ("hil.sweeping.one_run", lambda *_: _task()),
    "hil.service.jobs.child": ("hil.service.jobs.work", lambda _, arguments: _job(arguments)),
}
"""Of a module as `python -m` takes it: what is loaded before the fork, and what is done in it."""

_STARTERS = (
    "hil.boards.emulation", "hil.cli.run_live", "hil.report.artist", "hil.running.recording.recorder",
    "hil.running.process.start", "hil.service.board.line", "hil.service.board.link_process", "hil.service.jobs.jobs",
    "hil.sweeping.process",
)  # fmt: skip


@contextmanager
def forking() -> Iterator[None]:
    """What has been loaded of those that start processes forks them, for the length of the block."""
    loaded = [module for name in _STARTERS if (module := sys.modules.get(name)) is not None]
    before = [module.subprocess for module in loaded]
    _fork_from_here()
    try:
        yield
    finally:
        for module, real in zip(loaded, before, strict=True):
            module.subprocess = real  # type: ignore[attr-defined]


def _fork_from_here() -> None:
    for name in _STARTERS:
        if (module := sys.modules.get(name)) is not None:
            module.subprocess = _FORKING  # type: ignore[attr-defined]


class Forked(subprocess.Popen[Any]):
    """A `subprocess.Popen` of `python … -m MODULE ARGUMENTS`: pipes, session and descriptors as asked for there."""

    def _execute_child(self, *given: Any) -> None:
        """In place of the standard library's, of which it takes the descriptors by name."""
        asked = _AS_GIVEN.bind(self, *given).arguments
        folders = (os.environ if asked["env"] is None else asked["env"]).get("PYTHONPATH", "").split(os.pathsep)
        if not set(folders) <= {"", *_FOLDERS, *sys.path}:  # other packages than here
            super()._execute_child(*given)  # type: ignore[misc]
            return
        module = asked["args"].index("-m") + 1
        (name, main), arguments = _MAINS[asked["args"][module]], asked["args"][module + 1 :]
        loaded = importlib.import_module(name)
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
            if asked["env"] is not None:
                os.environ.clear()
                os.environ.update(asked["env"])
            if asked["cwd"] is not None:
                os.chdir(asked["cwd"])
            if os.environ.get("PYTHONWARNINGS") == "error":
                warnings.simplefilter("error")
            _run(lambda: main(loaded, arguments), ours, tuple(asked["pass_fds"]))
        gc.enable()
        self._child_created = True
        self._close_pipe_fds(*(asked[name] for name in _PIPES))  # type: ignore[attr-defined]


_FORKING = SimpleNamespace(
    Popen=Forked,
    **{name: getattr(subprocess, name) for name in ("DEVNULL", "PIPE", "STDOUT", "SubprocessError", "TimeoutExpired")},
)
_PIPES = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")


def hil_says(*arguments: str, **given: Any) -> "subprocess.CompletedProcess[str]":
    """`hil ARGUMENTS`, to its end; given: as of `subprocess.Popen`."""
    asked = [sys.executable, "-m", "hil", *arguments]
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with Forked(asked, **pipes, **given) as process:
        said = process.communicate(timeout=200.0)
    return subprocess.CompletedProcess(asked, process.returncode, *said)


def _command(arguments: list[str]) -> int:
    from hil import cli

    if "--live" in arguments:
        importlib.import_module("hil.cli.run_live")
        _fork_from_here()
    sys.argv[1:] = arguments
    cli.main()
    raise AssertionError("hil has not left")


def _artist() -> int:
    from hil.report import artist

    artist.main()
    return 0


def _keeper(keeper: Any, arguments: list[str]) -> int:
    sys.argv[1:] = arguments
    keeper.main()
    return 0


def _task() -> int:
    from hil.sweeping import child

    return child.main()


def _job(arguments: list[str]) -> int:
    from hil.service.jobs import child

    child.main(Path(*arguments))
    return 0


def _run(main: Callable[[], int], given: list[int], kept: tuple[int, ...]) -> None:
    """In the fork; never returns.  given: descriptors for the first three, -1 for one that stays as it is."""
    code = 1
    try:
        for number, descriptor in enumerate(given):
            if descriptor >= 0:
                os.dup2(descriptor, number)
        # Not closed but led nowhere: a library may close descriptors of its own after a fork, and end where it cannot.
        nowhere = os.open(os.devnull, os.O_RDWR)
        for descriptor in [int(link.name) for link in Path("/proc/self/fd").iterdir()]:
            if descriptor in kept:
                os.set_inheritable(descriptor, True)
            elif descriptor > 2:
                os.dup2(nowhere, descriptor)
        _fork_from_here()  # what was loaded for it alone as well
        signal.set_wakeup_fd(-1)  # of an event loop that has stayed behind
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        sys.stdin = open(0, closefd=False)  # noqa: SIM115 - theirs as long as the process
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        code = main()
    except SystemExit as left:
        code = int(left.code or 0)
    except BaseException:  # noqa: BLE001 - whatever it is, a fork must not go on as what it is a fork of
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
