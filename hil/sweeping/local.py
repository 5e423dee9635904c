"""Runs on this machine, a process for each of several workers."""

import os
import queue
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

from hil.sweeping.process import RunProcess
from hil.sweeping.tasks import Done, Task


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))


def carry_out_all(tasks: Iterator[Task], workers: int) -> Iterator[Done]:
    """Each as it is done, in whichever order.  Left early, it ends what is under way at once."""
    processes = [RunProcess() for _ in range(workers)]
    idle: queue.SimpleQueue[RunProcess] = queue.SimpleQueue()
    for process in processes:
        idle.put(process)

    def carried_out(task: Task) -> Done:
        process = idle.get()
        try:
            return process.carry_out(task)
        finally:
            idle.put(process)

    pool = ThreadPoolExecutor(workers)
    under_way: set[Future[Done]] = set()
    try:
        while True:
            while len(under_way) < 2 * workers and (task := next(tasks, None)) is not None:
                under_way.add(pool.submit(carried_out, task))
            if not under_way:
                return
            done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    finally:
        for process in processes:
            process.end()
        pool.shutdown(cancel_futures=True)
