"""A campaign carried out, as far as it is not yet."""

import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from hil.errors import InputError
from hil.progress import Progress, Watcher
from hil.sweeping import cluster, local
from hil.sweeping.kept import Kept
from hil.sweeping.one_run import Done, Task
from hil.sweeping.plan import Plan, Planned, toml_of
from hil.sweeping.program import program_digest

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
    plan: Plan, folder: Path, *, workers: int | None = None, scheduler: str | None = None, progress: Watcher
) -> Swept:
    """Make the runs that `folder` lacks, on `workers` processors of this machine (default all), or on the Dask cluster
    of `scheduler`.

    Raises InputError, with every run kept that was done by then; Stopped on Ctrl-C, likewise.
    """
    if workers is not None and workers < 1:
        raise InputError(f"--workers: {workers}; give a whole number from 1 on")
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
                _try_scenario(plan)
            for done in _done(kept, plan, workers, scheduler, say) if there < total else ():
                if kept.add(done):
                    made += 1
                    progress(Progress("runs", there + made, total, left_s=pace.left_s()))
        except KeyboardInterrupt:
            raise Stopped(f"{there + made} of {total} runs are done and kept in {folder}") from None
        if kept.missing:
            raise InputError(f"{folder}: {kept.missing} runs came back without a row; give the same command again")
    return Swept(folder, total, made, time.monotonic() - began)


def _done(kept: Kept, plan: Plan, workers: int | None, scheduler: str | None, say: "cluster.Say") -> Iterator[Done]:
    if scheduler is None:
        tasks = (task_of(plan, plan.run(number), str(kept.work)) for number in list(kept.to_do()))
        return local.carry_out_all(tasks, workers or local.cores())
    return cluster.carry_out_all(
        lambda: (task_of(plan, plan.run(number)) for number in list(kept.to_do())), scheduler, say
    )


def task_of(plan: Plan, planned: Planned, scratch: str | None = None) -> Task:
    """A run as it is handed out."""
    scenario, _ = plan.tables(planned)
    return Task(
        planned.run,
        toml_of(scenario, "The board."),
        plan.bench_of(planned).model_dump_json(),
        plan.campaign.each.model_dump(),
        scratch,
    )


def _try_scenario(plan: Plan) -> None:
    """Have the emulator read the first run's scenario: a key that it does not know is told before anything is made."""
    import tempfile

    from hil.wire.inproc import open_inproc

    scenario, _ = plan.tables(plan.run(0))
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "board.scenario.toml"
        file.write_text(toml_of(scenario, "The board."), encoding="utf-8")
        try:
            open_inproc(str(file)).close()
        except ValueError as error:
            raise InputError(f"{plan.source}: run 0: {str(error).replace(f'{file}: ', 'the scenario: ')}") from None


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
