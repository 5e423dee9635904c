"""The loop with the form of the missing force as an effect of one's own, beside the loop with the effect it is.

Each effect of the catalogue that a law without memory can say: a run in lockstep by the data sheet alone; its record's
missing force, with no effect of the catalogue as a candidate, written into the bench file as `hil trace --add` writes
it; the same run again with that, and with what a trace names from the catalogue.
"""

import tempfile
from pathlib import Path

from benchmarks.compensation import FITTED, SAMPLES, angle_error, problem_of, traced
from benchmarks.lockstep import close_loop
from benchmarks.row import Row, Say
from estimator.errors import ModelError
from estimator.missing_force.estimate import missing_force
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import draw_record
from hil.bench import load_bench, override
from hil.bench.template import template, values_of
from hil.records.force import to_model
from hil.tracing.addition import add_form

KINDS = (
    "cubic_stiffness",
    "cubic_isotropic",
    "quadratic_stiffness",
    "nonlinear_damping",
    "dry_friction",
    "nonreciprocal_stiffness",
    "sense_gain",
    "sense_cross_coupling",
    "sense_cubic",
    "drive_gain",
    "drive_misalignment",
    "electrostatic_drive",
)
DRAW = 52


def rows(say: Say) -> list[Row]:
    """Angle error without either, with the effect of the catalogue, with the form."""
    figures = []
    for name in KINDS:
        order = Order("single", (name,), 0, draw=DRAW)
        drawn = draw_record(order, SAMPLES)
        before = close_loop(drawn.scenario, drawn.bench, SAMPLES, seed=order.seed)
        found = traced(before, drawn.bench)
        named = override(drawn.bench, {"effects": found}, name)
        built_in = close_loop(drawn.scenario, named, SAMPLES, seed=order.seed) if found else before
        try:
            force = to_model(missing_force(problem_of(before, drawn.bench), int(FITTED * SAMPLES)))
        except ModelError as error:
            say(f"{name}: {error}")
            continue
        with tempfile.TemporaryDirectory() as aside:
            source, target = Path(aside) / "data-sheet.bench.toml", Path(aside) / "form.bench.toml"
            source.write_text(template(values_of(drawn.bench), "The data sheet."), encoding="utf-8")
            written, without = add_form(source, target, force, name)
            own = load_bench(target) if written else drawn.bench
        by_form = close_loop(drawn.scenario, own, SAMPLES, seed=order.seed) if written else before
        figures += [
            Row(f"{name}: angle error rms before", angle_error(before), "rad"),
            Row(f"{name}: … with {', '.join(found) or 'nothing'}", angle_error(built_in), "rad"),
            Row(f"{name}: … with its form", angle_error(by_form), "rad", "the effect",
                angle_error(by_form) / angle_error(built_in)),
        ]  # fmt: skip
        say(
            f"{name}: {force.text}; {len(written)} written{', without ' + ', '.join(without) if without else ''}; "
            f"{angle_error(before):.3g} → {angle_error(by_form):.3g} rad, "
            f"with {', '.join(found) or 'nothing'} {angle_error(built_in):.3g}"
        )
    return figures
