"""What a job does: calls of the library, each with what it came to."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hil
from hil.progress import Progress, Watcher

Said = Callable[[str], None]
"""Is told the name of the run folder as soon as there is one."""


def do(order: dict[str, Any], out: Path, place: Path, *, began: Said, progress: Watcher) -> dict[str, Any]:
    """Do what is ordered; runs are made below `out`, what is only needed meanwhile in `place`. Raises what the library
    does."""
    told = dict(order)
    return _KINDS[told.pop("kind")](told, out, place, began, progress)


def _run(order: dict[str, Any], out: Path, place: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    from hil.library.request import request_of
    from hil.loop.run import run

    truth = place / "truth.arrow" if order.pop("score", False) else None
    bench, link, _ = order.pop("bench"), order.pop("link"), order.pop("called", None)
    request = request_of(bench, {**order, "truth": truth}, link=link)  # type: ignore[typeddict-item]
    assert request.emulated  # was looked at before, and is not driven unasked
    done = run(request, out, begun=lambda folder, _: began(folder.name), progress=progress)
    assert done.folder is not None
    if truth is not None:
        progress(Progress("score", 0, 0))
        hil.score(done.folder, truth)
        truth.unlink(missing_ok=True)
    return _of_run(done.folder)


def _trace(order: dict[str, Any], out: Path, _: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    found = hil.trace(
        order["run"], order.get("bench"), fraction=order.get("fraction"), name=order.get("name"), out=out,
        progress=progress,
    )  # fmt: skip
    began(found.path.name)
    return {"run": found.path.name, "verdict": found.verdict, "effects": [effect.name for effect in found.effects]}


def _replay(order: dict[str, Any], out: Path, _: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    bench: Any = order.get("bench")
    if "effects_of" in order:
        trace = hil.load_trace(order["effects_of"])
        bench = trace.add_to(hil.load_bench(bench or Path(order["run"]) / "bench.toml"))
    done = hil.replay(order["run"], bench, name=order.get("name"), out=out, progress=progress)
    began(done.path.name)
    return _of_run(done.path)


def _import(order: dict[str, Any], out: Path, place: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    from hil.interchange.importer import import_record
    from hil.records.atomic import make_run_folder

    progress(Progress("import", 0, 0))
    made = place / "capture.arrow"
    given = order.get("map")
    capture = import_record(
        Path(order["upload"]), made, map_file=None if given is None else Path(given), hold=order.get("hold"),
        nonuniform=order.get("nonuniform", False),
    )  # fmt: skip
    figures = {"samples": len(capture), "axes": capture.axes, "tick_rate_Hz": capture.tick_rate_Hz}
    folder = make_run_folder(out, order["name"])
    began(folder.name)
    shutil.move(made, folder / "capture.arrow")
    return {"run": folder.name, "verdict": None, **figures}


def _sweep(order: dict[str, Any], out: Path, _: Path, __: Said, progress: Watcher) -> dict[str, Any]:
    from collections import Counter

    from hil.library.campaign import Sweep
    from hil.sweeping import local
    from hil.sweeping.plan import read_plan
    from hil.sweeping.sweep import sweep

    plan = read_plan(Path(order["campaign"]), called=order["typed"])
    folder = out / plan.campaign.name
    workers = order.get("workers") or max(local.cores() // 2, 1)
    done = sweep(plan, folder, workers=workers, progress=progress)
    if done.made:
        (folder / "report.html").unlink(missing_ok=True)
    progress(Progress("report", 0, 0))
    swept = Sweep(plan, folder)
    swept.report()
    outcomes = dict(Counter(swept.table["outcome"].to_pylist()))
    worst = [{"run": one.run, "value": one.value, "command": one.command} for one in swept.worst[:1]]
    return {
        "run": None, "verdict": None, "campaign": folder.name, "runs": done.runs, "made": done.made,
        "outcomes": outcomes, "figure": plan.campaign.report.figure, "worst": worst,
    }  # fmt: skip


def _pyramid(order: dict[str, Any], _: Path, __: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    from hil.records.pyramid import build

    record = Path(order["record"])
    began(record.parent.name)
    build(record, lambda done, total: progress(Progress("pyramid", done, total)))
    return {"run": record.parent.name, "verdict": None}


def _of_run(folder: Path) -> dict[str, Any]:
    run = hil.load(folder)
    result = run.result
    against = {name: part.reason for name, part in result.parts.items() if part.against}
    return {
        "run": folder.name, "verdict": result.verdict, "against": against,
        "angle_error_rms_rad": result.angle_error_rms_rad,
    }  # fmt: skip


_KINDS: dict[str, Callable[[dict[str, Any], Path, Path, Said, Watcher], dict[str, Any]]] = {
    "run": _run,
    "trace": _trace,
    "replay": _replay,
    "import": _import,
    "sweep": _sweep,
    "pyramid": _pyramid,
}
