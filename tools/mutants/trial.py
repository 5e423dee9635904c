"""One change at a time, in a process of its own in which the libraries are loaded already."""

import contextlib
import ctypes
import importlib
import importlib.util
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

from tools.mutants.changes import Mutant, mutants

_PROJECT = ("hil", "estimator", "device_emulator", "tests", "tools", "examples")
_LIBRARIES = (
    *("pytest", "_pytest.assertion.rewrite", "numpy", "scipy.special", "scipy.linalg", "scipy.signal"),
    *("sympy", "sympy.printing.pycode", "scipy.optimize", "scipy.integrate", "scipy.stats", "mpmath"),
    *("pyarrow.ipc", "pydantic", "typer", "rich", "can", "serial", "msgpack", "cobs.cobs", "crc32c"),
)
_UNUSED = ("cacheprovider", "schemathesis", "xdist", "xdist.looponfail", "pytest_cov", "anyio")  # plugins of pytest
_LONGER, _AT_LEAST_S = 4.0, 60.0  # than the tests without a change, on a machine that does other things, too
_HERE = Path(__file__).parent
_WITH_PARENT, _SUBREAPER = 1, 36  # PR_SET_PDEATHSIG and PR_SET_CHILD_SUBREAPER, linux/prctl.h


class Trials:
    """A module and the tests that belong to it.

    Attributes:
        path: of the module, relative to the current folder.
        possible: how many changes there are.
        seconds: what the tests take without a change, in which they have to pass.
    """

    def __init__(self, module: str, tests: list[str], *, slow: bool = False) -> None:
        self._module, place = _found(module)
        left_out = "realtime" if any("::" in one for one in tests) else "slow or realtime"  # what is named is meant
        self._tests = tests if slow else ["-m", f"not ({left_out})", *tests]
        self._all = mutants(place.read_text(encoding="utf-8"))
        self.path = Path(os.path.relpath(place))
        self.possible = len(self._all)
        self.seconds = 0.0
        ctypes.CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)  # what a killed trial leaves behind comes to this process
        for library in _LIBRARIES:
            importlib.import_module(library)
        self._passes(place, 600.0)  # Python's own caches are filled in the first
        begin = time.monotonic()
        if not self._passes(place, 600.0, show=True):
            raise SystemExit(f"the tests of {module} fail as it stands: {' '.join(tests)}")
        self.seconds = time.monotonic() - begin

    def chosen(self, sample: int, seed: int, lines: frozenset[int]) -> list[Mutant]:
        """All changes on `lines`, or without any, that many of the module; the same for the same seed."""
        if lines:
            return [mutant for mutant in self._all if mutant.line in lines]
        drawn = random.Random(seed).sample(range(len(self._all)), min(sample, len(self._all)))
        return [self._all[number] for number in sorted(drawn)]

    def survives(self, mutant: Mutant) -> bool:
        """Whether the tests pass with it."""
        with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
            changed = Path(folder) / "changed.py"
            changed.write_text(mutant.source, encoding="utf-8")
            return self._passes(changed, max(_LONGER * self.seconds, _AT_LEAST_S))

    def _passes(self, source: Path, patience_s: float, *, show: bool = False) -> bool:
        child = os.fork()
        if not child:
            os.setsid()
            self._run(source, show)
        end = time.monotonic() + patience_s
        status = None
        while status is None and time.monotonic() < end:
            time.sleep(0.02)
            found, code = os.waitpid(child, os.WNOHANG)
            status = code if found else None
        if status is None:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
        _reap()
        return status == 0

    def _run(self, source: Path, show: bool) -> None:
        """The tests, in a process that ends with them."""
        code = 1
        try:
            ctypes.CDLL(None).prctl(_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
            if not show:
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, 1)
                os.dup2(null, 2)
            else:
                os.dup2(2, 1)
            os.environ |= {
                "GYROHIL_MUTANT": self._module,
                "GYROHIL_MUTANT_SOURCE": str(source),
                "GYROHIL_WORKERS": "1",
                "GYROHIL_MUTANT_HOOK": str(_HERE / "hook.py"),
                "PYTHONPATH": f"{_HERE / 'site'}:{os.environ.get('PYTHONPATH', '')}",
            }
            for name in list(sys.modules):
                if name.partition(".")[0] in _PROJECT:
                    del sys.modules[name]
            from tools.mutants import hook

            hook.install()
            import pytest

            options = ["-x", "-q", "--no-header", *(word for name in _UNUSED for word in ("-p", f"no:{name}"))]
            code = int(pytest.main([*options, *self._tests]))
        except BaseException as error:  # of a change that breaks the import of the tests' own plugin, too
            print(f"{type(error).__name__}: {error}")
            raise
        finally:
            sys.stdout.flush()
            os._exit(code)


def _found(module: str) -> tuple[str, Path]:
    """The name by which a module is imported, and its file. Raises SystemExit for one that is not there."""
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        raise SystemExit(f"no module {module}")
    return module, Path(spec.origin)


def _reap() -> None:
    """End what a trial has left behind."""
    tasks = Path(f"/proc/{os.getpid()}/task")
    for task in tasks.iterdir():
        for child in (task / "children").read_text().split():
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(child), signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(int(child), 0)
