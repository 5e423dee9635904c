"""`hil trace` on the records, each without its truth; answers are kept beside the record, so that it can go on.

FOLDER/NAME/diagnosis.json   what tracing said
FOLDER/NAME/traced.json      by which estimator, how long it took, how it ended
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from benchmarks.row import Say
from hil.records.atomic import write_text

_ROOT = Path(__file__).parents[2]


def trace_all(places: list[Path], jobs: int, keep: bool, say: Say) -> None:
    """Trace the records in these folders that this estimator has not traced yet; `keep`: those that none has."""
    tracer = estimator_digest()
    waiting = [place for place in places if not _done(place, None if keep else tracer)]
    begin = time.monotonic()
    with ThreadPoolExecutor(jobs) as pool:  # each trace is a process of its own
        running = {pool.submit(trace_one, place, tracer): place for place in waiting}
        for done, future in enumerate(as_completed(running), 1):
            say(f"{done}/{len(waiting)} {running[future].name}: {future.result()}, {time.monotonic() - begin:.0f} s")


def trace_one(place: Path, tracer: str) -> str:
    """Trace one record from its capture and bench file; returns the verdict, or why there is none."""
    begin = time.monotonic()
    command = [sys.executable, "-m", "hil", "trace", str(place / "capture.arrow"), "--bench", str(place / "bench.toml")]
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    done = subprocess.run(
        [*command, "--out", str(place / "traces"), "--json", "--no-report"],
        capture_output=True,
        text=True,
        check=False,
        cwd=_ROOT,
        env=os.environ | one_thread,
    )
    shutil.rmtree(place / "traces", ignore_errors=True)
    said: dict[str, Any] = json.loads(done.stdout) if done.returncode in (0, 1) and done.stdout.strip() else {}
    last = (done.stderr.strip().splitlines() or [""])[-1]
    if said:
        write_text(place / "diagnosis.json", json.dumps(said, indent=1))
    else:
        (place / "diagnosis.json").unlink(missing_ok=True)
    note = {"tracer": tracer, "seconds": round(time.monotonic() - begin, 1), "exit": done.returncode, "said": last}
    write_text(place / "traced.json", json.dumps(note, indent=1))
    named = "+".join(effect["name"] for effect in said.get("effects", ()))
    return f"{said['verdict']} {named}" if said else f"exit {done.returncode}: {last}"


def estimator_digest() -> str:
    """A name for the estimator as it is: a change in its source is a reason to trace again."""
    digest = hashlib.sha256()
    for source in sorted((_ROOT / "estimator").rglob("*.py")):
        digest.update(str(source.relative_to(_ROOT)).encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]


def _done(place: Path, tracer: str | None) -> bool:
    note = place / "traced.json"
    return note.exists() and (tracer is None or json.loads(note.read_text())["tracer"] == tracer)
