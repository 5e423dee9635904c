"""Pieces of work on threads: order, errors, nesting, interruption; real threads, real signals."""

import os
import signal
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from estimator.errors import ModelError
from estimator.side_by_side import (
    WORKERS,
    Abandoned,
    interruptible,
    one_blas_thread,
    one_worker_each,
    side_by_side,
    stop_if_abandoned,
    workers,
)


def sleeping(result: int, seconds: float) -> Callable[[], int]:
    def piece() -> int:
        time.sleep(seconds)
        return result

    return piece


class Beside:
    """A piece that takes a while, and counts how many of it run at a time."""

    def __init__(self, seconds: float) -> None:
        self.most = self._running = 0
        self._seconds, self._lock = seconds, threading.Lock()

    def __call__(self) -> int:
        with self._lock:
            self._running += 1
            self.most = max(self.most, self._running)
        time.sleep(self._seconds)
        with self._lock:
            self._running -= 1
        return 0


def helpers_since(before: set[threading.Thread]) -> set[threading.Thread]:
    """Threads that were not there before: other tests may have left one of their libraries' behind."""
    return set(threading.enumerate()) - before


def patient(seconds: float, ended: list[str]) -> Callable[[], None]:
    """A piece that asks whether it is still wanted, as the observer does between two portions."""

    def piece() -> None:
        end = time.monotonic() + seconds
        try:
            while time.monotonic() < end:
                time.sleep(0.01)
                stop_if_abandoned()
        except Abandoned:
            ended.append("told")
            raise
        ended.append("by itself")

    return piece


def test_results_come_in_the_order_asked_for_whoever_is_first(monkeypatch):
    monkeypatch.setenv(WORKERS, "3")
    assert side_by_side([sleeping(0, 0.2), sleeping(1, 0.0), sleeping(2, 0.1), sleeping(3, 0.0)]) == [0, 1, 2, 3]
    assert side_by_side([]) == []


@pytest.mark.parametrize(("number", "inner", "outer"), [(1, 4, 3), (2, 6, 1), (3, 6, 1), (3, 1, 6), (2, 3, 2)])
def test_so_many_run_at_a_time_nested_or_not(monkeypatch, number, inner, outer):
    monkeypatch.setenv(WORKERS, str(number))
    leaf, before = Beside(0.03), set(threading.enumerate())
    side_by_side([lambda: side_by_side([leaf] * inner)] * outer)
    assert leaf.most == number
    assert helpers_since(before) == set()


def test_who_waits_for_a_helper_is_replaced(monkeypatch):
    """The first of two is over soon: whoever did it waits, and the second has two workers for its pieces."""
    monkeypatch.setenv(WORKERS, "2")
    beside = Beside(0.03)
    side_by_side([sleeping(0, 0.1), lambda: sum(side_by_side([beside] * 20))])
    assert beside.most == 2


def test_the_first_error_in_order_is_raised(monkeypatch):
    monkeypatch.setenv(WORKERS, "2")
    begun: list[int] = []

    def failing(number: int, seconds: float) -> Callable[[], None]:
        def piece() -> None:
            begun.append(number)
            time.sleep(seconds)
            raise ValueError(str(number))

        return piece

    with pytest.raises(ValueError, match=r"^0$"):
        side_by_side([failing(0, 0.2), failing(1, 0.0), failing(2, 0.0)])
    assert sorted(begun) == [0, 1]


def test_whoever_asked_is_told_of_each_that_is_finished_one_at_a_time(monkeypatch):
    monkeypatch.setenv(WORKERS, "3")
    told: list[int] = []
    side_by_side([sleeping(n, 0.01) for n in range(7)], done=told.append)
    assert told == [1, 2, 3, 4, 5, 6, 7]


def test_helpers_treat_floating_point_as_their_caller_does(monkeypatch):
    monkeypatch.setenv(WORKERS, "2")

    def piece() -> str:
        time.sleep(0.05)  # long enough for both threads to have one
        return np.geterr()["divide"]

    with np.errstate(divide="raise"):
        assert side_by_side([piece, piece]) == ["raise", "raise"]


@pytest.mark.parametrize("nested", [False, True])
def test_ctrl_c_stops_all_pieces_where_they_next_ask(monkeypatch, nested):
    monkeypatch.setenv(WORKERS, "3")
    ended: list[str] = []
    pieces = [patient(20.0, ended)] * 3
    inner = [lambda: side_by_side(pieces), lambda: patient(20.0, ended)()]
    before = set(threading.enumerate())
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        side_by_side(inner if nested else pieces)
    assert time.monotonic() - begin < 10.0  # where nobody asks, twenty
    timer.join()
    end = time.monotonic() + 10.0
    while helpers_since(before) and time.monotonic() < end:
        time.sleep(0.01)
    assert helpers_since(before) == set()
    assert set(ended) <= {"told"}


def test_ctrl_c_does_not_wait_for_one_long_call(monkeypatch):
    """A wait without the interpreter's lock stands for a kernel over a whole record."""
    monkeypatch.setenv(WORKERS, "1")
    begun, over, told = threading.Event(), threading.Event(), threading.Event()

    def press() -> None:
        begun.wait(60.0)  # a piece that is abandoned before it begins is not begun at all
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)

    def piece() -> None:
        begun.set()
        over.wait(60.0)  # in the caller's own thread a signal would end it: there it may not run
        try:
            stop_if_abandoned()
        except Abandoned:
            told.set()
            raise

    presser = threading.Thread(target=press)
    presser.start()
    with pytest.raises(KeyboardInterrupt):
        interruptible(piece)
    assert not told.is_set()
    over.set()
    assert told.wait(60.0)
    presser.join()


def test_interruptible_work_gives_its_result_or_its_error(monkeypatch):
    monkeypatch.setenv(WORKERS, "2")
    beside = Beside(0.03)
    assert interruptible(lambda: side_by_side([sleeping(n, 0.01) for n in range(4)] + [beside] * 8)) == [
        *range(4),
        *[0] * 8,
    ]
    assert beside.most == 2
    with pytest.raises(ZeroDivisionError):
        interruptible(lambda: 1 / 0)


def test_an_interruption_by_who_is_told_of_progress_ends_it(monkeypatch):
    monkeypatch.setenv(WORKERS, "2")
    ended: list[str] = []

    def watcher(_finished: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        side_by_side([sleeping(0, 0.1), patient(20.0, ended)], done=watcher)
    assert ended == ["told"]


def test_as_many_workers_as_processors_unless_told(monkeypatch):
    monkeypatch.delenv(WORKERS, raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0, 1, 5})
    assert workers() == 3
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: set(range(64)))
    assert workers() == 4
    monkeypatch.setenv(WORKERS, "9")
    assert workers() == 9
    one_worker_each()
    assert workers() == 1


@pytest.mark.parametrize("told", ["0", "-1", "two", "1.5"])
def test_no_number_of_workers_is_said(monkeypatch, told):
    monkeypatch.setenv(WORKERS, told)
    with pytest.raises(ModelError, match=f"{WORKERS}={told}: no number of workers"):
        side_by_side([lambda: 0] * 2)


@pytest.mark.moderate
def test_one_blas_thread_while_the_pieces_use_the_processors() -> None:
    """As many as before, behind it and behind an error."""

    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    with threadpool_limits(limits=2, user_api="blas"):
        with one_blas_thread():
            assert threads() == {1}
        assert threads() == {2}
        with pytest.raises(ModelError), one_blas_thread():
            raise ModelError("lost")
        assert threads() == {2}
