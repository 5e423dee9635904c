"""Coefficients from repeats: how many of their 95 % intervals agree.

Emulated records with known truth, twelve of each kind, traced as files; and parts of measured records, each beside the
others.  The answers are kept in runs/repeats.
"""

import json
import os
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from benchmarks.repeats.agreement import Repeated, share
from benchmarks.repeats.emulated import answer, gathered, tasks
from benchmarks.repeats.measured import emps, silverbox
from benchmarks.row import Row, Say
from estimator.side_by_side import one_worker_each
from evaluation.measured.__main__ import data_folder
from hil.records.atomic import write_text

FOLDER = Path("runs/repeats")
JOBS = 2


def rows(say: Say) -> list[Row]:
    """The share of each record, and of all."""
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    one_worker_each()
    with tempfile.TemporaryDirectory(prefix="gyrohil-") as work:
        measured = _measured(Path(work), say)
        with ProcessPoolExecutor(JOBS, mp_context=get_context("spawn")) as pool:
            answers = list(pool.map(partial(answer, work=Path(work)), tasks()))
    emulated = gathered(answers)
    for one in emulated:
        say(_told(one))
    FOLDER.mkdir(parents=True, exist_ok=True)
    kept = [
        {"record": one.record, "symbol": one.symbol, "values": list(map(float, one.values)),
         "halves": list(map(float, one.halves)), "truth": one.truth, "missed": one.missed, "off": one.off}
        for one in (*measured, *emulated)
    ]  # fmt: skip
    write_text(FOLDER / "answers.json", json.dumps(kept, indent=1, ensure_ascii=False) + "\n")
    made = []
    for repeated in (measured, emulated):
        for record in dict.fromkeys(one.record for one in repeated):
            made += _rows(record, [one for one in repeated if one.record == record])
    made += _rows("all with a truth", emulated)
    if measured:
        made += _rows("all of measured records", measured)
    return made + _rows("all", [*measured, *emulated])


def _measured(work: Path, say: Say) -> list[Repeated]:
    data, made = data_folder(), []
    for name, repeats in (("silverbox", silverbox), ("emps", emps)):
        if not (data / name).is_dir():
            say(f"{name}: left out, {data / name} is not there")
            continue
        made += repeats(data / name, work)
    for one in made:
        say(_told(one))
    return made


def _told(one: Repeated) -> str:
    missed = f", {one.missed} times not named" if one.missed else ""
    return f"{one.record}, {one.symbol}: {one.agree} of {len(one.off)}, scatter {one.spread:.2f}{missed}"


def _rows(what: str, repeated: Sequence[Repeated]) -> list[Row]:
    agree, number, low, high = share(repeated)
    missed = sum(one.missed for one in repeated)
    found = [
        Row(f"{what}: intervals", number, ""),
        Row(f"{what}: of these agree", 100.0 * agree / max(number, 1), "%"),
        Row(f"{what}: 95 % interval of that, from", 100.0 * low, "%"),
        Row(f"{what}: to", 100.0 * high, "%"),
    ]
    return [*found, Row(f"{what}: not named", missed, "")] if missed else found
