"""The runs, a few processes side by side; one JSON line each, so that a campaign can go on where it stopped."""

import json
import shutil
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.jobs import done_by
from benchmarks.row import Say
from benchmarks.verdicts.population import SAMPLES, plan
from evaluation.undeclared.population import Order

FOLDER = Path("runs/verdicts")
Line = dict[str, Any]


def campaign(orders: Sequence[Order], folder: Path, *, jobs: int, say: Say, samples: int = SAMPLES) -> list[Line]:
    """Run what has no line in FOLDER/lines.jsonl yet; the lines of all of `orders`."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "lines.jsonl"
    lines = {line["key"]: line for line in map(json.loads, kept.read_text().splitlines())} if kept.exists() else {}
    lines = {key: line for key, line in lines.items() if "failed" not in line}  # those are tried again
    waiting = [order for order in orders if key_of(order, samples) not in lines]
    begin = time.monotonic()
    with kept.open("a") as out:
        for done, (order, future) in enumerate(
            done_by(jobs, partial(run_one, folder=folder, samples=samples), waiting), 1
        ):
            error = future.exception()
            if error is None:
                line = future.result()
            else:  # a traceback of the product is a finding
                line = {
                    "key": key_of(order, samples),
                    "category": order.category,
                    "effects": list(order.effects),
                    "failed": f"{type(error).__name__}: {error}",
                }
            lines[line["key"]] = line
            out.write(json.dumps(line) + "\n")
            out.flush()
            say(f"{done}/{len(waiting)} {told(line)}, {time.monotonic() - begin:.0f} s")
    return [lines[key_of(order, samples)] for order in orders]


def key_of(order: Order, samples: int) -> str:
    """Of a run: the same word for the same device, effects and length."""
    return f"{order.draw} {order.name} {samples}"


def told(line: Line) -> str:
    """A line for people."""
    if "failed" in line:
        return f"{line['key']}: FAILED {line['failed']}"
    u = "no U" if line["angle_expanded_rad"] is None else f"U {line['angle_expanded_rad']:.2g}"
    rms = "no error" if line["error_rms_rad"] is None else f"error {line['error_rms_rad']:.2g} rad"
    return f"{line['key']}: {line['verdict']}, {rms}, {u}, {line['parts']['model']['reason'][:90]}"


def run_one(order: Order, folder: Path, samples: int) -> Line:
    """One `hil run` in lockstep with its truth, scored; what it said, and what was true."""
    from hil.bench import Bench
    from hil.bench.template import template, values_of
    from hil.errors import InputError
    from hil.records.atomic import write_text
    from hil.records.result import load_result
    from hil.records.runfolder import RunFolder
    from hil.running.request import RunRequest
    from hil.running.run import run
    from hil.scoring.score import score
    from hil.toml.reading import parse_table

    place = folder / f"{order.draw}-{order.name}"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    planned = plan(order, samples)
    line: Line = {"key": key_of(order, samples), "category": order.category, "effects": list(order.effects)}
    begin = time.monotonic()
    bench = parse_table(planned.bench, Bench, order.name)
    if planned.open_loop:
        bench = bench.with_(controller={"enabled": False})
    write_text(place / "device.scenario.toml", toml_of(planned.scenario))
    write_text(place / "device.bench.toml", template(values_of(bench), "The data sheet."))
    truth = place / "truth.arrow"
    board = f"inproc:{place / 'device.scenario.toml'}"
    came = run(RunRequest(bench, board, {"truth": truth}), place, progress=lambda _: None)
    assert came.folder is not None
    line["seconds"] = round(time.monotonic() - begin, 1)
    try:
        said = score(came.folder, truth)
    except InputError:  # the run ended before there was anything to score
        said = load_result(RunFolder(came.folder).result_path)
    line |= {
        "verdict": said.verdict,
        "parts": {name: part.model_dump() for name, part in said.parts.items()},
        "remarks": said.remarks,
        "angle_expanded_rad": said.angle_expanded_rad,
        "budget": [row.model_dump() for row in said.uncertainty],
        "error_rms_rad": said.angle_error_rms_rad,
        "error_max_rad": said.score.angle_error_max_rad if said.score else None,
        "error_end_rad": said.score.angle_error_end_rad if said.score else None,
        "innovation_ratio": ratio(said.innovation_rms, said.noise_floor),
        "scan": None if said.scan is None else said.scan.model_dump(exclude={"cannot_exclude"}),
        "unexcluded": [] if said.scan is None else [row.model_dump() for row in said.scan.cannot_exclude[:8]],
    }
    shutil.rmtree(place, ignore_errors=True)
    return line


def ratio(rms: float | None, floor: float | None) -> float | None:
    """One over the other, where there are both."""
    return rms / floor if rms is not None and floor else None


def toml_of(table: dict[str, Any]) -> str:
    """A scenario as a TOML file: tables of plain values, one level deep, and lists of them."""
    lines: list[str] = []
    for name, value in sorted(table.items(), key=lambda item: isinstance(item[1], dict | list)):
        if isinstance(value, dict):
            lines += [f"[{name}]", *(f"{key} = {json.dumps(one)}" for key, one in value.items())]
        elif isinstance(value, list):
            for entry in value:
                lines += [f"[[{name}]]", *(f"{key} = {json.dumps(one)}" for key, one in entry.items())]
        else:
            lines.append(f"{name} = {json.dumps(value)}")
    return "\n".join(lines) + "\n"
