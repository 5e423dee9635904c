"""`python -m evaluation.tracers EMULATOR`: the tracer on records of one emulator, judged.

EMULATOR is `alder`, `birch` or `cedar` (evaluation/strangers).  Answers are kept in FOLDER/trace, so that it can go on.
"""

import argparse
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.jobs import done_by
from evaluation.undeclared.judging import class_of
from hil.errors import InputError
from hil.importing.importer import import_record
from hil.records.atomic import write_text
from hil.tracing.request import request_of
from hil.tracing.trace import trace

Answer = dict[str, Any]


def main() -> int:
    """Make, trace, judge, print; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.tracers", description=__doc__)
    parser.add_argument("emulator", choices=["alder", "birch", "cedar"])
    parser.add_argument("--seed", type=int, default=1, help="of the records (default 1)")
    parser.add_argument("--folder", type=Path, required=True, help="of the records and the answers")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--most", type=int, default=10**6, help="records at most")
    options = parser.parse_args()
    folder: Path = options.folder
    if not (folder / "truth.json").exists():
        maker = [sys.executable, "-m", f"evaluation.strangers.{options.emulator}"]
        subprocess.run([*maker, "--seed", str(options.seed), "--out", str(folder)], check=True)
    places = sorted(folder.glob("[0-9][0-9].csv"))[: options.most]
    found = {place.stem: future.result() for place, future in done_by(options.jobs, _traced, places)}
    answers = dict(sorted(found.items()))
    summary = _judged(folder, answers)
    seconds = np.array([answer["cpu_s"] for answer in answers.values()])
    summary["cpu_s"] = {"median": float(np.median(seconds)), "95 %": float(np.quantile(seconds, 0.95))}
    write_text(folder / "trace.json", json.dumps(summary, indent=1) + "\n")
    print(json.dumps(summary, indent=1))
    return 0


def _traced(place: Path) -> Answer:
    """The diagnosis of one record, kept beside the others."""
    kept = place.parent / "trace" / f"{place.stem}.json"
    if kept.exists():
        answer: Answer = json.loads(kept.read_text())
        return answer
    kept.parent.mkdir(exist_ok=True)
    capture, bench = kept.with_suffix(".arrow"), place.with_suffix(".bench.toml")
    import_record(place, capture, map_file=None, nonuniform=False)
    begin = time.process_time()
    try:
        request = request_of(capture, bench, {"report": False})
        done = trace(request, kept.with_suffix(""), progress=lambda _: None)
        answer = {"diagnosis": json.loads((done.folder / "diagnosis.json").read_text())}
    except InputError as refusal:
        answer = {"diagnosis": None, "refused": str(refusal)}
    answer["cpu_s"] = time.process_time() - begin
    write_text(kept, json.dumps(answer))
    return answer


def _judged(folder: Path, answers: Mapping[str, Answer]) -> dict[str, Any]:
    """By kind of record, how many were answered right; intervals of effects named right that hold the truth."""
    truth = json.loads((folder / "truth.json").read_text())
    right, number, intervals, wrong = Counter[str](), Counter[str](), [0, 0], {}
    for name, answer in answers.items():
        kind, hidden = truth[name]["kind"], truth[name]["effects"]
        said = answer["diagnosis"] or {"verdict": "refused", "effects": [], "ambiguity_groups": []}
        number[kind] += 1
        if _is_right(kind, [effect["name"] for effect in hidden], said):
            right[kind] += 1
        else:
            wrong[name] = [kind, [e["name"] for e in hidden], said["verdict"], [e["name"] for e in said["effects"]]]
        for effect in said["effects"] if said["verdict"] == "explained" else ():
            for true in hidden:
                if true["name"] == effect["name"]:
                    for symbol, value in true["coefficients"].items():
                        if symbol in effect["coefficients"]:
                            low, high = effect["coefficients"][symbol]["ci95"]
                            intervals[0] += low <= value <= high
                            intervals[1] += 1
    return {
        "right": {kind: [right[kind], number[kind]] for kind in number}, "intervals": intervals, "not right": wrong
    }  # fmt: skip


def _is_right(kind: str, hidden: list[str | None], said: Mapping[str, Any]) -> bool:
    """Clean: adequate. Effects: explained by just these, or by members of their groups. Outside: neither word."""
    if kind == "clean":
        return bool(said["verdict"] == "adequate")
    if kind == "outside":
        return said["verdict"] not in ("explained", "adequate")
    named = [effect["name"] for effect in said["effects"]]
    groups = [class_of(name, said["ambiguity_groups"]) for name in named]
    found = all(any(name in group for group in groups) for name in hidden)
    return said["verdict"] == "explained" and found and len(named) == len(hidden)


if __name__ == "__main__":
    sys.exit(main())
