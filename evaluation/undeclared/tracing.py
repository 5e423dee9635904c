"""What `hil trace` says of the records, each without its truth; answers are kept beside them, so that it can go on.

FOLDER/NAME/diagnosis.json   what tracing said
FOLDER/NAME/traced.json      by which estimator, how long it took, why it was refused, if it was
"""

import hashlib
import json
import shutil
import time
from functools import cache
from pathlib import Path

from evaluation.undeclared.population import Order
from evaluation.undeclared.record import made_of, make
from hil.errors import InputError
from hil.records.atomic import write_text
from hil.tracing.request import request_of
from hil.tracing.trace import trace

_ROOT = Path(__file__).parents[2]


def done(order: Order, folder: Path, samples: int, *, making: bool, tracing: bool, keep: bool) -> str:
    """Make a record where it is not there, if `making`; trace it, if `tracing`, where this estimator has not, or none
    has if `keep`.  In a word what came of it.  Raises InputError as `evaluation.undeclared.record.make`.
    """
    place = make(order, folder, samples) if making else made_of(order, folder, samples)
    tracer = estimator_digest()
    if not tracing or is_traced(place, None if keep else tracer):
        return "there"
    return trace_one(place, tracer)


def trace_one(place: Path, tracer: str) -> str:
    """Trace one record from its capture and bench file as `hil trace` does; the verdict, or why there is none."""
    begin = time.monotonic()
    (place / "diagnosis.json").unlink(missing_ok=True)
    said = ""
    try:
        request = request_of(place / "capture.arrow", place / "bench.toml", {"report": False})
        traced = trace(request, place / "traces", progress=lambda _: None)
    except InputError as refusal:
        said = str(refusal)
    else:
        shutil.move(traced.folder / "diagnosis.json", place / "diagnosis.json")
    shutil.rmtree(place / "traces", ignore_errors=True)
    note = {"tracer": tracer, "seconds": round(time.monotonic() - begin, 1), "refused": said}
    write_text(place / "traced.json", json.dumps(note, indent=1))
    if said:
        return f"refused: {said}"
    return f"{traced.diagnosis.verdict} {'+'.join(effect.name for effect in traced.diagnosis.effects)}"


@cache
def estimator_digest() -> str:
    """A name for the estimator as it is: a change in its source is a reason to trace again."""
    digest = hashlib.sha256()
    for source in sorted((_ROOT / "estimator").rglob("*.py")):
        digest.update(str(source.relative_to(_ROOT)).encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]


def is_traced(place: Path, tracer: str | None) -> bool:
    """Whether the record has an answer, of this estimator where one is named."""
    note = place / "traced.json"
    return note.exists() and (tracer is None or json.loads(note.read_text())["tracer"] == tracer)
