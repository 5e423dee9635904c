"""A campaign carried out, as far as it is not yet."""

import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from hil.errors import InputError
from hil.progress import Progress, Watcher
from hil.sweeping import cluster, process
from hil.sweeping.kept import Kept
from hil.sweeping.plan import Plan
from hil.sweeping.program import program_digest
from hil.sweeping.tasks import Done

_PACE = 200
"""The time left goes by the pace of the last so many runs."""
_GROUND = 3


class Stopped(KeyboardInterrupt):
    """Ctrl-C, and what is there by then."""


class Swept(NamedTuple):
    """Where the results are, how many runs the campaign has, how many of them were made just now, in how long."""

    folder: Path
    runs: int
    made: int
    seconds: float


def sweep(
    plan: Plan,
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    arm: bool = False,
    progress: Watcher,
) -> Swept:
    """Make the runs that `folder` lacks, on `workers` processors of this machine (default all), or on the Dask cluster
    of `scheduler`; those with a table or a chamber one after the other on one board, which `arm` permits.

    Raises InputError, with every run kept that was done by then; Stopped on Ctrl-C, likewise.
    """
    if workers is not None and workers < 1:
        raise InputError(f"--workers: {workers}; give a whole number from 1 on")
    if scheduler is not None:
        cluster.require_address(scheduler)
    began = time.monotonic()
    made = 0
    with Kept.opened(folder, plan, program_digest()) as kept:
        total = len(plan)
        there = total - kept.missing
        pace = _Pace(total - there)
        progress(Progress("runs", there, total, note=f"{there} are there already" if there else ""))

        def say(words: str) -> None:
            progress(Progress("runs", there + made, total, note=words))

        try:
            if there == 0:
                plan.require_sound()
            for done in _done(kept, workers, scheduler, say, arm=arm) if there < total else ():
                if kept.add(done):
                    made += 1
                    progress(Progress("runs", there + made, total, left_s=pace.left_s()))
        except KeyboardInterrupt:
            raise Stopped(f"{there + made} of {total} runs are done and kept in {folder}") from None
        if kept.missing:
            raise InputError(f"{folder}: {kept.missing} runs came back without a row; give the same command again")
    return Swept(folder, total, made, time.monotonic() - began)


def _done(kept: Kept, workers: int | None, scheduler: str | None, say: "cluster.Say", *, arm: bool) -> Iterator[Done]:
    plan = kept.plan
    if plan.campaign.instruments:
        from hil.sweeping.with_instruments import carry_out_all

        if scheduler is not None or (workers or 1) > 1:
            raise InputError("--workers: one board with its table or chamber makes one run at a time; leave it out")
        return carry_out_all(plan, list(kept.to_do()), kept.folder, arm=arm)
    if scheduler is None:
        tasks = (plan.task(number, str(kept.work)) for number in list(kept.to_do()))
        return process.carry_out_all(tasks, workers or process.cores())
    return cluster.carry_out_all(
        lambda: (plan.task(number) for number in list(kept.to_do())), kept.program, scheduler, say
    )


class _Pace:
    """How long the rest takes, by the last runs."""

    def __init__(self, left: int) -> None:
        self._left = left
        self._ends: deque[float] = deque([time.monotonic()], _PACE)

    def left_s(self) -> float | None:
        """Seconds, after one more run; None while there is no ground."""
        self._left -= 1
        self._ends.append(time.monotonic())
        if len(self._ends) <= _GROUND:
            return None
        return self._left * (self._ends[-1] - self._ends[0]) / (len(self._ends) - 1)
