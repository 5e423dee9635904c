"""The form of a missing force on emulated devices with something that nobody declared.

`python -m benchmarks missing_force`: records of evaluation/undeclared of a draw that no other figure uses: each kind
outside the catalogue, and each effect of the catalogue.  Judged here, by the scenario: does the form hold the true
terms, and what share of the force does it leave on the part held out.  Records and answers are kept in
runs/missing_force.
"""

import json
import os
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.row import Row, Say
from estimator.errors import ModelError
from estimator.missing_force.estimate import missing_force
from estimator.side_by_side import one_worker_each
from estimator.trace.likelihood import AT_FLOOR
from estimator.trace.problem import Problem
from evaluation.undeclared.effects import DRAWABLE, OUTSIDE
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import make
from hil.bench import load_bench
from hil.inputs.captured import control_of, drives_of, record_of
from hil.inputs.declared import device_of, observer_settings_of
from hil.records.atomic import write_text
from hil.records.capture import read_capture
from hil.records.force import to_model

FOLDER = Path("runs/missing_force")
DRAW = 77
FITTED = 0.6
JOBS = 1
THIRD = 1.0 / 3.0

_LATE = ({"sensed sense delay"}, {"drive delay"})
_WAVE = ({"interference"}, {"base vibration"}, {"sensed interference"})

OF_THE_LIBRARY: dict[str, tuple[set[str], ...]] = {
    "stick_slip_support": (),
    "backlash": ({"q beyond ±g"},),
    "telegraph_offset": (),
    "parametric_stiffness": ({"q cos(w t), q sin(w t)"},),
    "nonlinear_coupling": ({"∇(x³ y)"},),
    "missing_codes": (),
    "drive_slew": (),
    "sense_delay": _LATE,
    "drive_delay": _LATE,
    "interference": _WAVE,
    "base_vibration": _WAVE,
}
"""What a form must hold to be the true one, in one way or another; none: the library has no such term; of an effect
that is not here, its own name.

What the equations cannot tell apart counts either way: a line that pushes and one that is sensed, a delay of both
senses and one of both drives.
"""


def ways(name: str) -> tuple[set[str], ...]:
    """The forms that are true of an effect."""
    plain = name.replace("_", " ")
    return OF_THE_LIBRARY.get(name, ({plain}, {f"sensed {plain}"}))


def orders() -> list[Order]:
    """The records, kinds outside the catalogue first."""
    kinds = [("outside", name) for name in OUTSIDE] + [("single", name) for name in DRAWABLE]
    return [Order(category, (name,), 0, DRAW) for category, name in kinds]


def rows(say: Say) -> list[Row]:
    """Record, estimate, judge."""
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    one_worker_each()
    begin = time.monotonic()
    answers = []
    with ProcessPoolExecutor(JOBS, mp_context=get_context("spawn")) as pool:
        running = {pool.submit(asked, order): order for order in orders()}
        for done, future in enumerate(as_completed(running), 1):
            answers.append(answer := future.result())
            say(f"{done}/{len(running)} {running[future].name}: {told(answer)}, {time.monotonic() - begin:.0f} s")
    answers.sort(key=lambda one: str(one["name"]))
    write_text(FOLDER / "answers.json", json.dumps(answers, indent=1, ensure_ascii=False) + "\n")
    return [
        *_rows("all", answers),
        *_rows("outside the catalogue", [one for one in answers if one["category"] == "outside"]),
        *_rows("an effect of the catalogue, no candidate", [one for one in answers if one["category"] == "single"]),
    ]


def _rows(what: str, answers: list[dict[str, Any]]) -> list[Row]:
    shown = [one for one in answers if one["shown"]]
    n = max(len(shown), 1)
    return [
        Row(f"{what}: records", len(answers), ""),
        Row(f"{what}: in which something stands above the noise", len(shown), ""),
        Row(f"{what}: of these, the form holds the true terms", 100.0 * sum(one["true"] for one in shown) / n, "%"),
        Row(f"{what}: and has no other term", 100.0 * sum(one["alone"] for one in shown) / n, "%"),
        Row(
            f"{what}: at most a third of the force is left, held out",
            100.0 * sum(one["left"] is not None and one["left"] <= THIRD for one in shown) / n,
            "%",
        ),
    ]


def told(answer: dict[str, Any]) -> str:
    """A line."""
    if answer["refused"]:
        return f"refused: {answer['refused']}"
    form = ", ".join(answer["form"]) or "no form"
    right = "true" if answer["true"] else "not the true terms"
    return f"{form} ({right}); innovation {answer['before']:.3g} to {answer['after']:.3g}, {answer['left']:.1%} left"


def asked(order: Order) -> dict[str, Any]:
    """One record's answer, with the judgement."""
    place = make(order, FOLDER)
    begin = time.monotonic()
    name = order.effects[0]
    answer: dict[str, Any] = {"name": order.name, "category": order.category, "draw": order.draw, "refused": ""}
    problem, split = problem_at(place)
    try:
        with np.errstate(all="ignore"):
            found = missing_force(problem, split)
    except ModelError as error:
        return answer | {"refused": str(error), "shown": True, "true": False, "alone": False, "left": None, "form": []}
    form = [f"{'sensed ' if term.sense else ''}{term.form}" for term in found.form.terms]
    true = [way for way in ways(name) if way <= set(form)]
    return answer | {
        "form": form,
        "true": bool(true),
        "alone": any(way == set(form) for way in true),
        "shown": found.form.before > AT_FLOOR,
        "before": found.form.before,
        "after": found.form.after,
        "left": found.form.left,
        "said": json.loads(to_model(found).model_dump_json()),
        "seconds": round(time.monotonic() - begin, 1),
    }


def problem_at(place: Path) -> tuple[Problem, int]:
    """What tracing is asked of a record, and where the part held out begins; the truth is not looked at."""
    bench, capture = load_bench(place / "bench.toml"), read_capture(place / "capture.arrow")
    device = device_of(bench)
    record = record_of(capture, drives_of(capture, device))
    problem = Problem(record, device, observer_settings_of(bench), control_of(bench, capture))
    return problem, int(FITTED * len(record))
