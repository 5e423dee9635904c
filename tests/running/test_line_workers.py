"""The kernel's workers that carry a serial line's bytes: ahead while a run lasts, and as they were after it.

The priorities are read from Linux, not from what the module keeps of them.
"""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from hil.running.process import line_workers

pytestmark = pytest.mark.realtime(alone=True)  # the machine's workers are there once, and other runs have them, too

ORDINARY, AHEAD = (os.SCHED_OTHER, 0), (os.SCHED_FIFO, 1)
SERIAL = "serial:/dev/pts/0"
may_set = pytest.mark.skipif(
    not line_workers.permitted(), reason="priorities of the kernel's workers are not ours here"
)


def priorities() -> dict[int, tuple[int, int]]:
    """Policy and real-time priority of each unbound worker as in proc(5), stat, those of high priority left out."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended
            pid, comm, rest = re.fullmatch(r"(\d+) \((.*)\) (.*)\n", stat.read_text()).groups()  # type: ignore[union-attr]
            fields = ("", "", "", *rest.split())  # as they are counted there: from 1, and the state is the third
            if comm.startswith("kworker/u") and fields[19] == "0":
                found[int(pid)] = int(fields[41]), int(fields[40])
    return found


def becomes(done: Callable[[], bool]) -> bool:
    """Whether it does within some seconds."""
    end = time.monotonic() + 10.0
    while not (is_so := done()) and time.monotonic() < end:
        time.sleep(0.02)
    return is_so


def all_ahead() -> bool:
    return set(priorities().values()) == {AHEAD}


def none_ahead() -> bool:
    return set(priorities().values()) == {ORDINARY}


@pytest.fixture(autouse=True)
def nobody_left_them_ahead() -> None:
    """Tests that kill hosts do."""
    with line_workers.ahead(SERIAL):
        pass


@may_set
def test_they_are_ahead_while_it_lasts_and_then_as_before() -> None:
    assert becomes(none_ahead)
    with line_workers.ahead(SERIAL):
        assert becomes(all_ahead)
    assert becomes(none_ahead)


@may_set
@pytest.mark.parametrize("link", ["can:can0", "udp:239.0.0.1:4242", "inproc:s-slow"])
def test_other_links_need_none_of_it(link: str) -> None:
    with line_workers.ahead(link):
        time.sleep(0.2)
        assert none_ahead()


@may_set
def test_what_somebody_else_has_put_ahead_stays_there() -> None:
    mine = next(iter(line_workers.line_workers()))
    os.sched_setscheduler(mine, os.SCHED_FIFO, os.sched_param(3))
    try:
        with line_workers.ahead(SERIAL):
            assert becomes(lambda: AHEAD in priorities().values())
            assert priorities()[mine] == (os.SCHED_FIFO, 3)
        assert priorities()[mine] == (os.SCHED_FIFO, 3)
    finally:
        os.sched_setscheduler(mine, os.SCHED_OTHER, os.sched_param(0))


@may_set
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_process_of_its_own_does_it_until_it_is_ended(number: int) -> None:
    with subprocess.Popen([sys.executable, "-m", "hil.running.process.line_workers"]) as process:
        assert becomes(all_ahead)
        process.send_signal(number)
        assert process.wait(10.0) == 0
    assert becomes(none_ahead)


@may_set
def test_a_killed_host_s_priorities_are_given_back_by_the_next_run() -> None:
    with subprocess.Popen([sys.executable, "-m", "hil.running.process.line_workers"]) as process:
        assert becomes(all_ahead)
        process.kill()
    assert AHEAD in priorities().values()
    with line_workers.ahead(SERIAL):
        pass
    assert becomes(none_ahead)


def refuse(*_: object) -> None:
    raise PermissionError


def test_where_it_is_not_permitted_the_run_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert not line_workers.permitted()
    with line_workers.ahead(SERIAL):
        pass


def test_without_permission_the_process_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with pytest.raises(SystemExit, match=r"^line workers: not permitted.*sudo [^\n]*$"):
        line_workers.main()


def test_from_inside_a_container_there_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(line_workers, "_PROC", tmp_path)
    monkeypatch.setattr(line_workers, "_OF_THE_KERNEL", tmp_path / "children")
    assert list(line_workers.line_workers()) == []
    assert not line_workers.permitted()
