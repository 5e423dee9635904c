"""Runs on a Dask cluster: the same tasks, handed to whichever workers there are.

A worker that dies is the scheduler's to make good.  Should the scheduler die, this process waits for it to come back
and hands out anew what it has no row of; a row that comes twice is dropped where they are kept.
"""

import json
import logging
import queue
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from hil.errors import InputError
from hil.sweeping.process import ATTEMPTS, carry_out_here
from hil.sweeping.tasks import Done, Task

if TYPE_CHECKING:
    from distributed import Client

Say = Callable[[str], None]

_CONNECT_S = 10.0
_AGAIN_S = 120.0  # for a scheduler that was lost to come back
_LOOK_S = 1.0
_PER_THREAD = 3  # tasks at the cluster for each of its threads: the next one is there when one ends
_LEAST = 8


class _Lost(Exception):
    """The scheduler is gone."""


def require_address(scheduler: str) -> None:
    """InputError for what no scheduler can have as its address, be there runs left to make or not."""
    host, _, port = scheduler.rpartition(":")
    if not host.rpartition("://")[2] or not port.isdecimal():
        raise InputError(f"--scheduler: {scheduler}: no address; give it as tcp://HOST:8786")


def carry_out_all(tasks: Callable[[], Iterator[Task]], program: str, scheduler: str, say: Say) -> Iterator[Done]:
    """Each as it is done; `tasks` gives those that have no row yet, whenever it is asked; `program`: what has
    to make them.

    Raises InputError where no scheduler answers, a worker runs another version of the program, or the scheduler does
    not come back.
    """
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise InputError("--scheduler: Dask is not installed; pip install 'gyrohil[cluster]'") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong there is told here, in a line
    client = _connected(scheduler, _CONNECT_S)
    if client is None:
        raise InputError(f"--scheduler: {scheduler}: no scheduler answers there; start one with `dask scheduler`")
    while True:
        try:
            yield from _handed_out(client, tasks(), program, say)
            return
        except _Lost:
            say(f"the scheduler at {scheduler} is gone; waiting for it for {_AGAIN_S:.0f} s")
        finally:
            _left(client)
        if (again := _connected(scheduler, _AGAIN_S)) is None:
            raise InputError(f"--scheduler: {scheduler}: is gone; start it and give the same command again")
        client = again
        say("the scheduler is back")


def _connected(scheduler: str, within_s: float) -> "Client | None":
    from distributed import Client

    until = time.monotonic() + within_s
    while time.monotonic() < until:
        try:
            return Client(scheduler, timeout=min(within_s, 5.0), set_as_default=False)
        except (OSError, TimeoutError):
            time.sleep(0.2)
        except ValueError as error:
            raise InputError(f"--scheduler: {scheduler}: {error}; give it as tcp://HOST:8786") from None
    return None


def _left(client: "Client") -> None:
    with suppress(OSError, TimeoutError, RuntimeError):  # it may be gone
        client.close(timeout=2.0)


def _handed_out(client: "Client", tasks: Iterator[Task], program: str, say: Say) -> Iterator[Done]:
    """As long as the scheduler lives."""
    under_way: dict[Any, Task] = {}
    finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
    deaths: dict[int, int] = {}

    def submit(task: Task) -> None:
        # Not pure: a key made of the task would have a run that was lost with its worker taken for the new one.
        future = client.submit(carry_out_here, task.as_json(), pure=False)
        under_way[future] = task
        future.add_done_callback(finished.put)

    alone = False
    while True:
        threads = _threads(client)
        if not threads and not alone:
            say("the cluster has no workers; waiting for one (`dask worker ADDRESS`)")
        alone = not threads
        while len(under_way) < max(_PER_THREAD * threads, _LEAST) and (task := next(tasks, None)) is not None:
            submit(task)
        if not under_way:
            return
        try:
            future = finished.get(timeout=_LOOK_S)
        except queue.Empty:
            continue
        task = under_way.pop(future)
        if future.status == "finished":
            yield _checked(future.result(), program)
        elif future.status == "pending":  # done it was, and its row lost with the worker that had it
            under_way[future] = task
            future.add_done_callback(finished.put)
        elif future.status == "cancelled":  # nobody here cancels: the scheduler that knew of it was gone
            raise _Lost
        elif future.status != "error":
            _require(client)
            submit(task)
        elif type(error := future.exception()).__name__ != "KilledWorker":
            raise error
        elif deaths.setdefault(task.run, 1) < ATTEMPTS:
            deaths[task.run] += 1
            submit(task)
        else:
            row = {"outcome": "crashed", "reason": "the workers that had it died"}
            yield Done(task.run, row, {"seconds": None, "host": "", "pid": None})


def _threads(client: "Client") -> int:
    _require(client)
    try:
        return sum(client.nthreads().values())
    except (OSError, TimeoutError, AttributeError, RuntimeError):  # as the connection goes, or has gone
        raise _Lost from None


def _require(client: "Client") -> None:
    if client.status != "running":
        raise _Lost


def _checked(line: str, program: str) -> Done:
    said = json.loads(line)
    if said.pop("program") != program:
        raise InputError(
            f"--scheduler: the worker on {said['wall']['host']} has another version of the program; install this one"
        )
    return Done(**said)
