"""Which thresholds change which answers: several at once, and fewer where an answer changes."""

import hashlib
import json
import math
import os
import random
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from threading import Timer
from typing import Any

from benchmarks.row import Say
from benchmarks.thresholds.change import SIDES, Changes
from estimator.side_by_side import WORKERS
from evaluation.undeclared.tracing import estimator_digest
from hil.records.atomic import write_text

Answer = dict[str, Any]

AT_ONCE = 8
_PATIENCE_S = 900.0


@dataclass
class Asker:
    """Answers by other thresholds, each in a process; those that were had before, from its folder."""

    folder: Path
    digest: str = field(default_factory=estimator_digest)
    _idle: list["_Child"] = field(default_factory=list)

    def ask(self, changes: Changes, records: Sequence[str], *, afresh: bool = False) -> dict[str, Answer]:
        """By record; afresh: by a process of its own, which says what was read."""
        kept = {record: self._kept(changes, record) for record in records}
        found = {record: json.loads(place.read_text()) for record, place in kept.items() if place.exists()}
        if missing := [record for record in records if record not in found]:
            found |= self._had(changes, missing, afresh)
            for record in missing:
                kept[record].parent.mkdir(parents=True, exist_ok=True)
                write_text(kept[record], json.dumps(found[record]))
        return {record: found[record] for record in records}

    def _kept(self, changes: Changes, record: str) -> Path:
        name = json.dumps([self.digest, sorted(changes.items()), record])
        return self.folder / "answers" / f"{hashlib.sha256(name.encode()).hexdigest()[:24]}.json"

    def _had(self, changes: Changes, records: Sequence[str], afresh: bool) -> dict[str, Answer]:
        try:
            child = None if afresh else self._idle.pop()
        except IndexError:
            child = None
        if child is None:
            child = _Child(self.folder)
            if not afresh:
                child.ask({"changes": {}, "records": []})
        asked = {"changes": dict(changes), "records": list(records), "watch": afresh and not changes}
        answers = child.ask(asked)
        if afresh or answers is None:
            child.end()
        else:
            self._idle.append(child)
        return answers or {record: {"verdict": "no answer", "words": [], "seconds": 0.0} for record in records}

    def end(self) -> None:
        """No more is asked."""
        for child in self._idle:
            child.end()


class _Child:
    """A process that answers line by line."""

    def __init__(self, folder: Path) -> None:
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", WORKERS), "1")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.thresholds.child", str(folder)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, **threads},
        )  # fmt: skip

    def ask(self, asked: dict[str, Any]) -> dict[str, Answer] | None:
        """The answers by record; None where the process ended, or was ended since it took too long."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        timer = Timer(_PATIENCE_S, self._process.kill)
        timer.start()
        try:
            self._process.stdin.write(json.dumps(asked) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        finally:
            timer.cancel()
        found: dict[str, Answer] | None = json.loads(line) if line else None
        return found

    def end(self) -> None:
        """Its input ends, and so does it."""
        self._process.communicate()


@dataclass(frozen=True)
class _Job:
    """Thresholds that are changed together, and the records that are asked."""

    side: str
    names: tuple[str, ...]
    records: tuple[str, ...]

    @property
    def changes(self) -> Changes:
        return dict.fromkeys(self.names, self.side)


def same(one: Answer, other: Answer) -> bool:
    """Whether two answers say the same."""
    return bool(one["verdict"] == other["verdict"] and one["words"] == other["words"])


def screen(
    asker: Asker, names: Sequence[str], records: Sequence[str], jobs: int, say: Say, minutes: float = math.inf
) -> dict[str, Any]:
    """What each threshold changes: {"baseline": …, "read": …, "half": {name: {record: answer}}, "double": …,
    "open": {side: {name: [record]}}}; open is what was not told apart after so many minutes.
    """
    begin = time.monotonic()
    baseline = asker.ask({}, records, afresh=True)
    for record, answer in baseline.items():
        say(f"as they are, {record}: {answer['verdict']}")
    reads = {name: tuple(r for r in records if name in baseline[r]["read"]) for name in names}
    early = frozenset(name for answer in baseline.values() for name in answer["early"])
    changed: dict[str, dict[str, dict[str, Answer]]] = {side: {} for side in SIDES}
    still: dict[str, dict[str, list[str]]] = {side: {} for side in SIDES}
    waiting = deque(_first(names, records, reads, early))
    over = begin + 60.0 * minutes
    with ThreadPoolExecutor(jobs) as pool:
        running: dict[Future[dict[str, Answer]], _Job] = {}
        while waiting or running:
            while waiting and len(running) < jobs and time.monotonic() < over:
                job = waiting.popleft()
                afresh = not early.isdisjoint(job.names)
                running[pool.submit(asker.ask, job.changes, job.records, afresh=afresh)] = job
            if not running:  # the time is over
                for job in waiting:
                    _note(still, job, reads)
                break
            ready, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                job, answers = running.pop(future), future.result()
                differ = tuple(r for r in job.records if not same(answers[r], baseline[r]))
                if differ and len(job.names) > 1:  # at once, so that what was begun is told apart
                    waiting.extendleft(_halves(job, differ, reads))
                elif differ:
                    changed[job.side].setdefault(job.names[0], {}).update({r: answers[r] for r in differ})
                    told = "; ".join(f"{r}: {answers[r]['verdict']}" for r in differ)
                    at = f"{time.monotonic() - begin:.0f} s, {len(waiting) + len(running)} left"
                    say(f"{at}: {job.side} {job.names[0]}: {told}")
    asker.end()
    return {"open": still, "baseline": baseline, "read": {name: list(on) for name, on in reads.items()}, **changed}


def added(kept: dict[str, Any], found: dict[str, Any]) -> dict[str, Any]:
    """What was kept, with what was found of some thresholds on some records in its place: what they did on others
    stays.  Where the thresholds as they are give another answer now than is kept, a change says beside which one it was
    seen.
    """
    asked, reads = set(found["baseline"]), found["read"]

    def beside(changes: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """Each with the answer as it is now, where another one is kept."""
        now, then = found["baseline"], kept["baseline"]
        return {
            name: {
                record: answer
                if record not in then or same(now[record], then[record])
                else answer | {"beside": {key: now[record][key] for key in ("verdict", "words")}}
                for record, answer in answers.items()
            }
            for name, answers in changes.items()
        }

    def over(kept: dict[str, dict[str, Any]], found: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """By name and record."""
        return kept | {
            name: {record: one for record, one in kept.get(name, {}).items() if record not in asked}
            | found.get(name, {})
            for name in reads
        }

    def listed(kept: dict[str, list[str]], found: dict[str, list[str]]) -> dict[str, list[str]]:
        """The same of names with their records alone."""
        before, after = ({name: dict.fromkeys(on) for name, on in one.items()} for one in (kept, found))
        return {name: list(on) for name, on in over(before, after).items()}

    return {
        **kept,
        "baseline": found["baseline"] | kept["baseline"],
        "read": listed(kept["read"], reads),
        "open": {side: _some(listed(kept["open"][side], found["open"][side])) for side in SIDES},
        **{side: _some(over(kept[side], beside(found[side]))) for side in SIDES},
    }


def _some(by_name: dict[str, Any]) -> dict[str, Any]:
    """Those that have something."""
    return {name: found for name, found in by_name.items() if found}


def _first(
    names: Sequence[str], records: Sequence[str], reads: dict[str, tuple[str, ...]], early: frozenset[str]
) -> Iterable[_Job]:
    """Groups of those that a record reads, drawn at random: what stands side by side belongs to one step, where one may
    make up for another.  Each record by itself, so that one more of them asks nothing anew; but those that are read on
    import, which take a process each, of all records at once.
    """
    asked = [(tuple(records), [name for name in names if name in early and reads[name]])]
    late = [name for name in names if name not in early]
    asked += [((record,), [name for name in late if record in reads[name]]) for record in records]
    for on, members in asked:
        random.Random(1).shuffle(members)
        for first in range(0, len(members), AT_ONCE):
            for side in SIDES:
                yield _Job(side, tuple(members[first : first + AT_ONCE]), on)


def _note(still: dict[str, dict[str, list[str]]], job: _Job, reads: dict[str, tuple[str, ...]]) -> None:
    for name in job.names:
        if on := [record for record in reads[name] if record in job.records]:
            still[job.side].setdefault(name, []).extend(on)


def _halves(job: _Job, differ: tuple[str, ...], reads: dict[str, tuple[str, ...]]) -> Iterable[_Job]:
    middle = len(job.names) // 2
    for group in (job.names[:middle], job.names[middle:]):
        if on := tuple(r for r in _of(group, reads) if r in differ):
            yield _Job(job.side, group, on)


def _of(group: tuple[str, ...], reads: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(record for name in group for record in reads[name]))
