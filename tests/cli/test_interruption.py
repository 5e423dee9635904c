"""A signal that comes while a module is imported ends the program all the same, and leaves the module whole."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.errors.interruption import interrupt

LOSES_IT = """
import os, time
whole = False
try:
    os.kill(os.getpid(), {number})
    time.sleep(0.05)
    whole = True
except BaseException:
    pass
"""


@pytest.fixture(params=[signal.SIGINT, signal.SIGTERM])
def number(request: pytest.FixtureRequest) -> Iterator[signal.Signals]:
    """A signal that `interrupt` handles, as SIGALRM after it; both as they were in the end."""
    kept = {one: signal.getsignal(one) for one in (request.param, signal.SIGALRM)}
    signal.signal(request.param, interrupt)
    yield request.param
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for one, handler in kept.items():
        signal.signal(one, handler)


def test_outside_of_an_import_it_interrupts_at_once(number: signal.Signals) -> None:
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), number)


def test_an_import_is_finished_first(number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "loses_it.py").write_text(LOSES_IT.format(number=int(number)))
    (tmp_path / "around_it.py").write_text("import loses_it\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "loses_it", raising=False)
    monkeypatch.delitem(sys.modules, "around_it", raising=False)
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012 - it comes after the import, in what follows
        import around_it  # type: ignore[import-not-found]

        for _ in range(100):
            signal.sigtimedwait([], 0.02)
    assert around_it.loses_it.whole


def test_a_handler_of_later_gets_what_waited(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "loses_it.py").write_text(LOSES_IT.format(number=int(number)).replace("0.05", "0.001"))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "loses_it", raising=False)
    import loses_it  # type: ignore[import-not-found]

    assert loses_it.whole
    came: list[int] = []
    signal.signal(number, lambda one, _: came.append(one))
    for _ in range(100):
        signal.sigtimedwait([], 0.02)
        if came:
            break
    assert came == [number]


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("signalled", [signal.SIGINT, signal.SIGTERM])
def test_a_trace_does_not_wait_for_an_import_that_compiles(tmp_path: Path, signalled: int) -> None:
    """One that takes half a minute: under load, with an empty cache, kernels take minutes."""
    (tmp_path / "typer.py").write_text("import time\nprint('begun', flush=True)\ntime.sleep(30.0)\n")
    words = [sys.executable, "-c", "from hil.cli import main; main()", "trace"]
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": paths}
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "begun\n"
        begin = time.monotonic()
        process.send_signal(signalled)
        assert process.wait(30.0) == 130
        assert time.monotonic() - begin < 1.0
        assert process.stderr.read() == "hil: interrupted\n"
