"""The form of a missing force on emulated devices with something that nobody declared.

`python -m evaluation.missing_force`: records of evaluation/undeclared of a draw that no other figure uses: each kind
outside the catalogue, and each effect of the catalogue.  Judged here, by the scenario: does the form hold the true
terms, and what share of the force does it leave on the part held out.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from estimator.errors import ModelError
from estimator.missing_force.estimate import missing_force
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

DRAW = 77
FITTED = 0.6
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


def main() -> None:
    """Record, estimate, judge, and print what came of it."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.missing_force", description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("runs/missing_force"), help="default %(default)s")
    parser.add_argument("--only", default="", help="effects whose name contains this")
    options = parser.parse_args()
    kinds = [("outside", name) for name in OUTSIDE] + [("single", name) for name in DRAWABLE]
    answers = []
    for category, name in kinds:
        if options.only in name:
            answers.append(answer := asked(Order(category, (name,), 0, DRAW), options.folder))
            print(f"{answer['name']}: {told(answer)}, {answer['seconds']:.0f} s", flush=True)
    write_text(options.folder / "answers.json", json.dumps(answers, indent=1, ensure_ascii=False) + "\n")
    for category, what in (("outside", "outside the catalogue"), ("single", "of the catalogue, no candidate")):
        shown = [one for one in answers if one["category"] == category and one["shown"]]
        true, alone = (sum(one[word] for one in shown) for word in ("true", "alone"))
        less = sum(one["left"] is not None and one["left"] <= THIRD for one in shown)
        print(
            f"{what}: of {len(shown)} above the noise {true} hold the true terms, {alone} no other; in {less} at most "
            "a third of the force is left on the part held out"
        )


def told(answer: dict[str, Any]) -> str:
    """A line."""
    if answer["refused"]:
        return f"refused: {answer['refused']}"
    form = ", ".join(answer["form"]) or "no form"
    right = "true" if answer["true"] else "not the true terms"
    return f"{form} ({right}); innovation {answer['before']:.3g} to {answer['after']:.3g}, {answer['left']:.1%} left"


def asked(order: Order, folder: Path) -> dict[str, Any]:
    """One record's answer, with the judgement."""
    place = make(order, folder)
    begin = time.monotonic()
    name = order.effects[0]
    answer: dict[str, Any] = {"name": order.name, "category": order.category, "draw": order.draw, "refused": ""}
    problem, split = problem_at(place)
    try:
        with np.errstate(all="ignore"):
            found = missing_force(problem, split)
    except ModelError as error:
        return answer | {
            "refused": str(error),
            "shown": True,
            "true": False,
            "alone": False,
            "left": None,
            "form": [],
            "seconds": 0.0,
        }
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


if __name__ == "__main__":
    main()
