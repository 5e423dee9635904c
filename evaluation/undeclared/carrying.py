"""One record of the campaign: made, traced and judged; what it came to is a row.

A record and its answer stay in a folder of the record's name, so another campaign of the same draw, a larger one say,
has them already.
"""

import hashlib
import json
import os
import socket
import time
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from evaluation.undeclared.judging import Judgement, judge
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import made_of, make
from evaluation.undeclared.tracing import estimator_digest, is_traced, trace_one
from hil.errors import InputError
from hil.sweeping.program import program_digest
from hil.sweeping.tasks import Done, Row, Task

_PARTS = ("evaluation.undeclared", "benchmarks")
"""Besides what a run of `hil sweep` goes through."""


def carry_out(task: Task) -> Done:
    """Do a task of `evaluation.undeclared.campaign`.  Raises OSError where this machine is at fault."""
    began = time.perf_counter()
    try:
        row = _row(task.what)
    except InputError as error:  # another record is in its place
        row = {"outcome": "refused", "reason": str(error)}
    wall = {"seconds": round(time.perf_counter() - began, 3), "host": socket.gethostname(), "pid": os.getpid()}
    return Done(task.run, row, wall)


def _row(what: Mapping[str, Any]) -> Row:
    order = Order(what["category"], tuple(what["effects"]), what["number"], what["draw"])
    folder = Path(what["folder"])
    place = make(order, folder, what["samples"]) if what["make"] else made_of(order, folder, what["samples"])
    truth = json.loads((place / "truth.json").read_text())
    row: Row = {
        "outcome": "made",
        "samples": truth["samples"],
        "record_sha256": _digest_of(place / "capture.arrow"),
        "innovation_ratio": truth["innovation_ratio"],
    }
    if what["trace"]:
        if not is_traced(place, None if what["keep"] else estimator_digest()):
            trace_one(place, estimator_digest())
        row |= _judged(truth, place)
    return row


def _judged(truth: dict[str, Any], place: Path) -> Row:
    said = place / "diagnosis.json"
    judged = judge(truth, json.loads(said.read_text()) if said.exists() else None)
    refused = json.loads((place / "traced.json").read_text())["refused"].replace(f"{place}/", "")
    return {
        "outcome": "refused" if refused else "traced",
        "reason": refused or None,
        "verdict": judged.verdict,
        "named": "+".join(judged.named),
        "right": judged.right,
        "first_class": judged.first_class,
        "first_member": judged.first_member,
        "misnamed": judged.misnamed,
        "before": judged.before,
        "after": judged.after,
        "judgement": written(judged),
    }


def written(judged: Judgement) -> str:
    """A judgement as a line."""
    return json.dumps(asdict(judged))


def read(line: str) -> Judgement:
    """A judgement that was written."""
    told = json.loads(line)
    for name in ("truth", "named", "right_class"):
        told[name] = tuple(told[name])
    told["statements"] = tuple((float(probability), bool(so)) for probability, so in told["statements"])
    return Judgement(**told)


@cache
def program() -> str:
    """Of every source file that a record goes through, its judgement included."""
    digest = hashlib.sha256(f"{program_digest()} {estimator_digest()}".encode())
    for part in _PARTS:
        spec = find_spec(part)
        for folder in map(Path, (spec.submodule_search_locations if spec else None) or ()):
            for source in sorted(folder.glob("*.py")):
                if part != "benchmarks" or source.name == "lockstep.py":
                    digest.update(f"{part}/{source.name}\0".encode() + source.read_bytes())
    return digest.hexdigest()[:16]


def _digest_of(capture: Path) -> str:
    with capture.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
