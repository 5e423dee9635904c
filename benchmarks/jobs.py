"""Much work by a few processes with one thread each: what is done is handed back as it comes."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TypeVar

from estimator.side_by_side import one_worker_each

Item = TypeVar("Item")
Result = TypeVar("Result")


def done_by(jobs: int, one: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[tuple[Item, "Future[Result]"]]:
    """Each item with the future that `one` of it has ended in; nothing more is begun when the caller stops early."""
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")  # as many processes as processors
    one_worker_each()
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        running = {pool.submit(one, item): item for item in items}
        try:
            for future in as_completed(running):
                yield running[future], future
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
