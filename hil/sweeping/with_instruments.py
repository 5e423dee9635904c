"""Runs of a campaign with a table or a chamber: one after the other on one board, each at its targets.

Whatever ends the campaign, the table comes to rest; so it does after each run that ended early.
"""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from hil.errors import InputError
from hil.progress import alarm, alarms_only
from hil.records.instruments import read_instruments, write_instruments
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest, request_of, require_consent
from hil.running.run import run
from hil.sweeping.instrument import Opened, Watched
from hil.sweeping.one_run import digest_of
from hil.sweeping.plan import Plan
from hil.sweeping.tasks import Done, Row
from hil.wire.errors import WireError

RUNS = "runs"
"""Below the campaign's folder: the run folders of its runs, which are kept."""


def carry_out_all(plan: Plan, numbers: list[int], folder: Path, *, arm: bool) -> Iterator[Done]:
    """Each run in order, as it is done.  Raises InputError where an instrument, the board or a consent is missing."""
    requests = {number: _request(plan, number) for number in numbers}
    for request in requests.values():
        require_consent(request, given=arm)
    with ExitStack() as held:
        opened: list[Opened] = []
        for name, declared in plan.campaign.instruments.items():
            opened.append(Opened(name, declared))
            held.callback(_close_quietly, opened[-1])
        held.callback(_bring_to_rest, opened)  # before the sessions are closed, whatever ends the campaign
        for number in numbers:
            began = time.perf_counter()
            row = _row(plan, number, requests[number], opened, folder)
            if row["outcome"] != "ran":
                _bring_to_rest(opened)
            yield Done(number, row, {"seconds": round(time.perf_counter() - began, 3)})


def _request(plan: Plan, number: int) -> RunRequest:
    what: Any = plan.task(number).what["run"]
    return request_of(plan.bench_of(plan.run(number)), what)


def _row(plan: Plan, number: int, request: RunRequest, opened: list[Opened], folder: Path) -> Row:
    targets = plan.targets(plan.run(number))
    try:
        for one in opened:
            if one.name in targets:
                one.bring_to(targets[one.name])
        with Watched(opened) as watched:
            done = run(request, folder / RUNS, report=True, progress=alarms_only)
    except (InputError, WireError) as error:
        return {"outcome": "refused", "reason": str(error)}
    assert done.folder is not None
    write_instruments(done.folder, [one.name for one in opened], watched.rows)
    return _figures(RunFolder(done.folder), watched.failed)


def _figures(place: RunFolder, failed: str) -> Row:
    result = place.result
    assert result is not None
    ended_early = next(iter(result.reasons), "") if result.verdict in ("interrupted", "unsafe") else ""
    stopped = ended_early or failed
    row: Row = {
        "outcome": "stopped" if stopped else "ran",
        "reason": stopped or None,
        "samples": result.samples,
        "record_sha256": digest_of(place.capture_path),
        "verdict": result.verdict,
        "angle_u_rad": result.angle_u_rad,
        "angle_expanded_rad": result.angle_expanded_rad,
    }
    actual = read_instruments(place.path)
    if "table" in actual:
        row["table_rate_rad_s"] = float(np.radians(np.mean(actual["table"])))
        if place.estimates is not None and "rate_rad_s" in place.estimates:
            scored = place.estimates.settled(place.settle_s)
            if len(scored):
                row["rate_less_table_rad_s"] = float(np.mean(scored["rate_rad_s"])) - row["table_rate_rad_s"]
    if "chamber" in actual:
        row["chamber_C"] = float(np.mean(actual["chamber"]))
    return row


def _bring_to_rest(opened: list[Opened]) -> None:
    """What may still move is told before everything else."""
    for one in opened:
        if said := one.to_rest():
            alarm(f"{said}; switch it off")


def _close_quietly(one: Opened) -> None:
    try:
        one.close()
    except Exception:  # noqa: BLE001 - it was brought to rest before
        return
