"""Many cases, some side by side, each judged in a file of its own, so that a campaign can go on where it stopped.

On CAN each of those side by side has a machine of its own with a virtual interface (`benchmarks.virtual_can`).
"""

import json
import os
import shutil
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from benchmarks.misbehaviour.judging import LIMIT_S, Case, broken, build, run
from benchmarks.row import Say
from benchmarks.virtual_can import NAME, has_can, with_vcan

ON_CAN = f"can:{NAME}"
_BOOT_S = 120.0


class Outcome(NamedTuple):
    """A case: what was not met, one line each; exit code of the bench; what it said."""

    told: list[str]
    code: int | None
    said: str


def on_link(every: Mapping[str, Case], link: str) -> dict[str, Case]:
    """The cases that mean something on a link: `pty`, or one of CAN."""
    kind = "pty" if link == "pty" else "can"
    return {name: case for name, case in every.items() if case.get("link", kind) == kind}


def campaign(every: Mapping[str, Case], link: str, folder: Path, jobs: int, say: Say) -> dict[str, Outcome]:
    """Run and judge what has not been judged in `folder` yet; the outcomes of all cases that mean something on `link`:
    `pty`, `can:vcan0` on this machine, or `vcan`, wherever that can be had."""
    wanted = on_link(every, link)
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    waiting = [name for name in wanted if not _file(folder, name).exists()]
    if waiting and link == "vcan":
        _on_machines(waiting, folder, 1 if has_can() else jobs)
    elif waiting:
        _here({name: wanted[name] for name in waiting}, link, folder, 1 if link == ON_CAN else jobs, say)
    return {name: _read(folder, name) for name in wanted}


def _here(wanted: dict[str, Case], link: str, folder: Path, jobs: int, say: Say) -> None:
    program = build(folder)

    def judge(name: str) -> None:
        place = folder / name
        shutil.rmtree(place, ignore_errors=True)
        seen = run(program, name, wanted[name], place, link)
        outcome = Outcome(broken(wanted[name], seen, link), seen.code, seen.said)
        _file(folder, name).write_text(json.dumps(outcome._asdict(), indent=1), encoding="utf-8")
        say(f"{name}: {'; '.join(outcome.told) or 'met'}")

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(judge, wanted))


def _on_machines(waiting: list[str], folder: Path, jobs: int) -> None:
    """Machines with a virtual CAN interface side by side, each with its share of the cases."""
    build(folder)
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}

    def share(k: int) -> None:
        place = folder / f"machine-{k}"
        place.mkdir(exist_ok=True)
        mine = waiting[k::jobs]
        command = [sys.executable, "-m", "benchmarks.misbehaviour", "--link", ON_CAN, "--keep", str(folder), *mine]
        with_vcan(command, environment, place, _BOOT_S + len(mine) * 4.0 * LIMIT_S)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(share, range(min(jobs, len(waiting)))))


def _file(folder: Path, name: str) -> Path:
    return folder / f"{name}.json"


def _read(folder: Path, name: str) -> Outcome:
    if not _file(folder, name).exists():
        return Outcome(["was not run to its end"], None, "")
    return Outcome(**json.loads(_file(folder, name).read_text(encoding="utf-8")))
