"""Runs with plug-ins against an emulated board."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.bench import Bench, override
from hil.progress import untold
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from tests.running import gyro

HERE = Path(__file__).parent
_UNCHANGED: Mapping[str, Mapping[str, Any]] = {}
OWN = f"{HERE / 'own.py'}:Own"


def bench(
    observer: str | None = None,
    controller: str | None = None,
    duration_s: float = 2.0,
    changes: Mapping[str, Mapping[str, Any]] = _UNCHANGED,
) -> Bench:
    """S-slow's, in lockstep, with these plug-ins."""
    named = {"observer": {"plugin": observer}, "controller": {"plugin": controller}}
    return override(override(gyro.bench(duration_s), changes, "test"), named, "test")


def ran(place: Path, declared: Bench, *, link: str | None = None, dry_run: bool = False) -> RunFolder:
    """The run of a bench against an emulated board, its truth beside it."""
    place.mkdir(exist_ok=True)
    scenario = gyro.scenario(place / "board.toml")
    request = RunRequest(declared, link or f"inproc:{scenario}", {"truth": place / "truth.arrow"}, dry_run=dry_run)
    done = run(request, place / "runs", progress=untold)
    assert done.folder is not None
    return RunFolder(done.folder)
