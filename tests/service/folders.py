"""Run folders: a real one, quickly, and as many as are wanted that say what it says with other figures."""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import hil
from hil.bench import examples
from hil.records.result import Result, save_result
from hil.running.request import RunRequest
from hil.running.run import run
from tests.made_once import made_once


def real_run(out: Path, *, seconds: float = 1.5, name: str = "real", report: bool = False) -> Path:
    """A lockstep run of an example; its folder below `out`."""
    changed = {"settle_s": 0.5, "duration_s": seconds, "clock": "lockstep", "name": name, "seed": 1}
    bench = hil.load_bench("s-slow").with_(loop=changed)
    link = f"inproc:{examples.find('scenario', 's-slow')}"
    done = run(RunRequest(bench, link), out, report=report, progress=lambda _: None)
    assert done.folder is not None
    return done.folder


def shared_run(places: pytest.TempPathFactory) -> Path:
    """The folder of such a run with its report, made once for all tests that leave it as it is."""
    made = made_once(places, "real", lambda place: real_run(place, report=True))
    (result,) = made.glob("*/result.json")
    return result.parent


def another(
    source: Path, out: Path, folder: str, result: Mapping[str, Any] | None = None, *, records: bool = False
) -> Path:
    """A folder called so, with the figures of `source` but for those in `result`; with its records where wanted."""
    target = out / folder
    target.mkdir(parents=True)
    for path in source.iterdir():
        if path.is_file() and path.name not in ("result.json", "report.html") and (records or path.suffix != ".arrow"):
            shutil.copyfile(path, target / path.name)
    told = json.loads((source / "result.json").read_text()) | {"run": folder} | dict(result or {})
    save_result(target / "result.json", Result.model_validate(told))
    return target
