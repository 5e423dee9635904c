"""What a job does: calls of the library, each with what it came to."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import hil
from hil.characterising.options import CharacteriseOptions
from hil.identifying.options import IdentifyOptions
from hil.importing.options import ImportOptions
from hil.options import chosen
from hil.progress import Progress, Watcher
from hil.replaying.options import ReplayOptions
from hil.running.options import RunOptions
from hil.sensors.options import RecordOptions
from hil.sweeping.options import SweepOptions
from hil.tracing.options import TraceOptions

Said = Callable[[str], None]
"""Is told the name of the run folder as soon as there is one."""


def do(order: dict[str, Any], out: Path, place: Path, *, began: Said, progress: Watcher) -> dict[str, Any]:
    """Do what is ordered; runs are made below `out`, what is only needed meanwhile in `place`. Raises what the library
    does."""
    told = dict(order)
    return _KINDS[told.pop("kind")](told, out, place, began, progress)


def _run(order: dict[str, Any], out: Path, place: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    from hil.running.request import request_of
    from hil.running.run import run

    truth = place / "truth.arrow" if order.get("score") else None
    options: Any = {**chosen(RunOptions, order), "truth": truth}
    request = request_of(order["bench"], options, link=order["link"])
    assert request.emulated  # was looked at before, and is not driven unasked
    done = run(request, out, begun=lambda folder, _: began(folder.name), progress=progress)
    assert done.folder is not None
    if truth is not None:
        progress(Progress("score", 0, 0))
        hil.score(done.folder, truth)
        truth.unlink(missing_ok=True)
    return _of_run(done.folder)


def _record(order: dict[str, Any], out: Path, _: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    options: Any = chosen(RecordOptions, order)
    done = hil.record(order["link"], out=out, progress=progress, **options)
    began(done.path.name)
    return {"run": done.path.name, "verdict": done.verdict}


def _trace(order: dict[str, Any], out: Path, _: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    options: Any = chosen(TraceOptions, order)
    found = hil.trace(order["run"], order.get("bench"), out=out, progress=progress, **options)
    began(found.path.name)
    return {"run": found.path.name, "verdict": found.verdict, "effects": [effect.name for effect in found.effects]}


def _replay(order: dict[str, Any], out: Path, _: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    bench: Any = order.get("bench")
    (record,) = order["run"]
    if "effects_of" in order:
        trace = hil.load_trace(order["effects_of"])
        bench = trace.add_to(hil.load_bench(bench or Path(record) / "bench.toml"))
    options: Any = chosen(ReplayOptions, order)
    done = hil.replay(record, bench, out=out, progress=progress, **options)
    began(done.path.name)
    return _of_run(done.path)


def _characterise(order: dict[str, Any], out: Path, _: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    options: Any = chosen(CharacteriseOptions, order)
    done = hil.characterise(order["run"], order.get("bench"), out=out, progress=progress, **options)
    began(done.path.name)
    sheet = done.sheet.model_dump(mode="json", exclude={"seal", "curves"})
    return {"run": done.path.name, "verdict": done.verdict, "sheet": sheet}


def _identify(order: dict[str, Any], out: Path, _: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    options: Any = chosen(IdentifyOptions, order)
    done = hil.identify(
        order.get("link"), bench=order.get("save"), record=order["run"], out=out, progress=progress, **options
    )  # without consent: it has to be an emulated board
    began(done.folder.name)
    found, verdict = done.findings.as_json(), "good" if done.good else "failed"
    name = None if done.bench is None else done.bench.name.removesuffix(".bench.toml")
    return {"run": done.folder.name, "verdict": verdict, "bench": name, "found": found}


def _import(order: dict[str, Any], out: Path, place: Path, began: Said, progress: Watcher) -> dict[str, Any]:
    from hil.records.atomic import make_run_folder

    progress(Progress("import", 0, 0))
    options: Any = chosen(ImportOptions, order)
    imported = hil.import_record(order["upload"], out=place / "capture.arrow", replace=True, **options)
    capture = imported.capture
    figures = {"samples": len(capture), "axes": capture.axes, "tick_rate_Hz": capture.tick_rate_Hz}
    folder = make_run_folder(out, order["name"])
    began(folder.name)
    shutil.move(imported.path, folder / "capture.arrow")
    told = {"said": list(imported.said), "left_out": list(imported.left_out)}
    return {"run": folder.name, "verdict": None, **figures, **told}


def _sweep(order: dict[str, Any], out: Path, _: Path, __: Said, progress: Watcher) -> dict[str, Any]:
    from collections import Counter

    from hil.library.campaign import carried_out
    from hil.sweeping import process
    from hil.sweeping.request import request_of

    options: Any = chosen(SweepOptions, order)
    options["workers"] = options["workers"] or max(process.cores() // 2, 1)
    request = request_of(order["campaign"], options, called=order["typed"])
    plan = request.plan
    swept = carried_out(replace(request, folder=out / plan.campaign.name), progress)
    progress(Progress("report", 0, 0))
    swept.report()
    outcomes = dict(Counter(swept.table["outcome"].to_pylist()))
    worst = [{"run": one.run, "value": one.value, "command": one.command} for one in swept.worst[:1]]
    return {
        "run": None, "verdict": None, "campaign": swept.path.name, "runs": len(plan), "made": swept.made,
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
    return {
        "run": folder.name, "verdict": result.verdict, "against": result.against,
        "angle_error_rms_rad": result.angle_error_rms_rad,
    }  # fmt: skip


_KINDS: dict[str, Callable[[dict[str, Any], Path, Path, Said, Watcher], dict[str, Any]]] = {
    "run": _run,
    "record": _record,
    "trace": _trace,
    "replay": _replay,
    "characterise": _characterise,
    "identify": _identify,
    "import": _import,
    "sweep": _sweep,
    "pyramid": _pyramid,
}
