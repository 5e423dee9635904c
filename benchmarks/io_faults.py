"""A disk that fails at the k-th call of a run that changes something on it, for every k and every way to fail.

The calls are those of all processes of one `hil run`, below its run folder and of its rings in shared memory: open,
write, fsync, ftruncate, rename, mkdir, fallocate, chmod, unlink, close. A library put before the C library makes them
fail; nothing in the bench knows of it. Once the worker writes the files itself (lockstep, emulated board in process),
once a recorder behind rings does (paced, emulated board on a pty).

What has to hold each time: the command ends by itself, without a traceback, exit code 1 or 2, and one line names the
failure; what is merely interrupted or short is done again, and nothing comes of it. The board is SAFE, by its own word.
What was written is what `hil check` can read; no process, no half file and no empty folder is left.

As it takes hours, `IO_FAULTS_EVERY=N` takes one k in N, with another beginning for each fault; `IO_FAULTS_WAY` and
`IO_FAULTS_KIND` take only the ways and the faults whose name holds that ("paced", "read-only"); `IO_FAULTS_FROM=K` goes
on from the K-th call where an earlier campaign was ended.
"""

import os
import tempfile
from collections import Counter
from pathlib import Path

from benchmarks.failing_disk import FAULTS
from benchmarks.failing_disk.campaign import WAYS, Campaign, Outcome
from benchmarks.row import Row, Say


def rows(say: Say) -> list[Row]:
    """How many runs, and how many in which all of it held."""
    every, first = (int(os.environ.get(f"IO_FAULTS_{which}", "1")) for which in ("EVERY", "FROM"))
    only, kind = os.environ.get("IO_FAULTS_WAY", ""), os.environ.get("IO_FAULTS_KIND", "")
    faults = [fault for fault in FAULTS if kind in fault]
    table: list[Row] = []
    for way in WAYS:
        if only in way:
            table += _of_way(say, way, faults, every, first)
    return table


def _of_way(say: Say, way: str, faults: list[str], every: int, first: int) -> list[Row]:
    with tempfile.TemporaryDirectory(prefix="io-faults-") as place, Campaign(Path(place), way).board() as campaign:
        calls = campaign.reach()
        say(f"{way}: {len(calls)} calls: {dict(Counter(call.split()[0] for call in calls))}")
        outcomes = []
        for number, fault in enumerate(faults):
            for at in range(first + number * every // len(faults), len(calls) + 1, every):
                outcomes.append(outcome := campaign.fail(fault, at))
                say(_told(outcome))
    hit = [outcome for outcome in outcomes if outcome.hit]
    return [
        Row(f"{way}: calls of a run", len(calls), "1"),
        Row(f"{way}: runs in which one failed", len(hit), "1"),
        *(Row(f"{way}: {fault}: all held", *_share(hit, fault)) for fault in faults),
        *(
            Row(f"{way}: exit code {code}", sum(outcome.code == code for outcome in hit), "1")
            for code in sorted({outcome.code for outcome in hit})
        ),
    ]


def _share(outcomes: list[Outcome], fault: str) -> tuple[int, str]:
    of_fault = [outcome for outcome in outcomes if outcome.fault == fault]
    return sum(not outcome.wrong for outcome in of_fault), f"of {len(of_fault)}"


def _told(outcome: Outcome) -> str:
    if not outcome.hit:
        return f"{outcome.fault}, {outcome.at}: not reached"
    bad = f"BAD {'; '.join(outcome.wrong)}: " if outcome.wrong else ""
    return f"{outcome.fault}, {outcome.at}: {outcome.hit}: {bad}{outcome.code} {outcome.verdict}, {outcome.line}"
