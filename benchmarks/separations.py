"""Do experiments tell look-alikes apart?  Calm devices that leave several accounts, and `hil trace --live` on each.

A device of the undeclared campaign lies still: no rate, no virtual rotation, no dither, no modulation.  Its record is
traced.  Where the diagnosis lists look-alikes that an experiment of the bench would tell apart, the experiments are
made on the same emulated board, as `--live` makes them, until none is proposed; the last diagnosis must name what was
hidden, first.  Where an experiment is to turn the gyro, which no host can, it is turned as it is asked for, give or
take 30 % in rate and time, about a rate that is not zero.  Devices whose record tells everything, or nothing, are
counted beside them; so are those that end on a look-alike of which the first diagnosis had said that no experiment of
four times the record tells it from what was hidden.

Results are kept in runs/separations, one file a device; what is there is not run again.  SEPARATIONS_DRAW is another
draw, SEPARATIONS of how many devices to make experiments, SEPARATIONS_JOBS how many processes, SEPARATIONS_SAMPLES how
long the first record is: the shorter, the more is left to experiments.
"""

import json
import math
import os
import shutil
from collections.abc import Collection, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.row import Row, Say
from benchmarks.verdicts.campaign import toml_of
from estimator.side_by_side import one_worker_each
from estimator.trace.experiments import Turn
from evaluation.undeclared.effects import DRAWABLE
from evaluation.undeclared.expected import expected
from evaluation.undeclared.judging import class_of, plain
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import draw_record
from hil.bench import Bench, override
from hil.errors import InputError
from hil.records.atomic import write_text
from hil.records.diagnosis import Diagnosis
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from hil.tracing.request import request_of
from hil.tracing.separate import Asked, last_traced, separable, separate
from hil.tracing.trace import trace

DRAW = 14
DEVICES = 30
SAMPLES = 20_000
KEPT = Path("runs/separations")
KINDS = tuple(name for name, drawable in DRAWABLE.items() if not drawable.slow)
"""A thermometer is beside the wire: its records are imports, and no experiment is made on those."""


def rows(say: Say) -> list[Row]:
    """As many devices as it takes to have so many experiments."""
    wanted = int(os.environ.get("SEPARATIONS", str(DEVICES)))
    jobs = int(os.environ.get("SEPARATIONS_JOBS", "2"))
    done: list[dict[str, Any]] = []
    samples = int(os.environ.get("SEPARATIONS_SAMPLES", str(SAMPLES)))
    orders = _orders(int(os.environ.get("SEPARATIONS_DRAW", str(DRAW))), done)
    KEPT.mkdir(parents=True, exist_ok=True)
    one_worker_each()
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        while sum(one["experiments"] > 0 and not one["told_in_vain"] for one in done) < wanted:
            for one in pool.map(partial(_one, samples), [next(orders) for _ in range(2 * jobs)]):
                done.append(one)
                say(f"{one['name']}: {one['before']}; {one['experiments']} experiments; {one['after']}")
    made = [one for one in done if one["experiments"]]
    tried = [one for one in made if not one["told_in_vain"]]
    return [
        Row("calm devices", len(done), "1"),
        Row("… an experiment proposed and made", len(tried), "1"),
        Row("… beside those told before that none tells them apart", len(made) - len(tried), "1"),
        Row("… of these, at last what was hidden is named", sum(one["right"] for one in tried), f"of {len(tried)}"),
        Row("… of these, a wrong name at last, without reserve", sum(one["wrong"] for one in tried), "1"),
        Row("experiments, most for one device", max(one["experiments"] for one in tried), "1"),
    ]


def _orders(draw_number: int, done: list[dict[str, Any]]) -> Iterator[Order]:
    """Every kind once; then, again and again, those of which a device has left what an experiment would tell apart."""
    number = 0
    while True:
        alike = {one["kind"] for one in done if one["experiments"]}
        for name in KINDS if number == 0 or not alike else [kind for kind in KINDS if kind in alike]:
            yield Order("still", (name,), number, draw_number)
        number += 1


def _one(samples: int, order: Order) -> dict[str, Any]:
    """What came of one device; from its file if it was there."""
    kept = KEPT / f"{order.draw}-{samples}-{order.name}.json"
    if kept.exists():
        return dict(json.loads(kept.read_text(encoding="utf-8")))
    place = kept.with_suffix("")
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    drawn = draw_record(order, samples)
    scenario = place / "device.scenario.toml"
    write_text(scenario, toml_of(drawn.table))
    bench = override(drawn.bench, {"loop": {"name": order.name.replace("_", "-")}}, order.name)
    link = f"inproc:{scenario}"
    folder = run(RunRequest(bench, link), place, progress=lambda _: None).folder
    assert folder is not None
    try:
        wanted = request_of(RunFolder(folder).capture_path, bench, {"report": False})
        first = trace(wanted, place, progress=lambda _: None).diagnosis
    except InputError as refusal:  # as of a drive that clips the converter: there is nothing to go on from
        return _kept(kept, {"name": order.name, "kind": order.effects[0], "before": f"refused: {refusal}"} | _NOTHING)
    hand = np.random.default_rng(order.seed + 1)

    def on_the_table(asked: Asked) -> None:
        """What the one who stands at the bench does before the board is armed."""
        turned = {**drawn.table, "rate": _by_hand(hand, asked.turn)} if asked.experiment.turning else drawn.table
        write_text(scenario, toml_of(turned))

    made = separate(
        first, bench, link, place, options={}, before_run=on_the_table, progress=lambda _: None
    ) if separable(first, bench) else ()  # fmt: skip
    traced = last_traced(made)
    last = first if traced is None else traced.diagnosis
    tables, sections = drawn.hidden[0].effects, drawn.hidden[0].sections
    names = expected(order.effects[0], tables, sections, _device(drawn)).names
    named = [plain(effect.name) for effect in last.effects]
    explained = last.verdict == "explained" and bool(named)
    right = explained and named[0] in names
    answer = {
        "name": order.name,
        "kind": order.effects[0],
        "before": _told(first),
        "experiments": len(made),
        "after": _told(last),
        "right": right,
        "told_in_vain": explained and not right and _told_in_vain(first, bench, named[0], names),
        "wrong": explained and not class_of(named[0], last.ambiguity_groups) & set(names),
    }
    return _kept(kept, answer)


_NOTHING = {"experiments": 0, "after": "", "right": False, "told_in_vain": False, "wrong": False}


def _kept(file: Path, answer: dict[str, Any]) -> dict[str, Any]:
    write_text(file, json.dumps(answer, indent=1))
    shutil.rmtree(file.with_suffix(""))
    return answer


def _by_hand(hand: np.random.Generator, turn: Turn) -> dict[str, Any]:
    """`[rate]` of a scenario: as was asked for, as well as a hand can tell."""
    return {
        "kind": "sine",
        "amplitude_rad_s": float(turn.rate * hand.uniform(0.7, 1.3)),
        "frequency_Hz": float(hand.uniform(0.7, 1.3) / turn.period),
        "phase_rad": float(hand.uniform(-math.pi, math.pi)),
        "offset_rad_s": float(turn.rate * hand.uniform(-0.5, 0.5)),
    }


def _device(drawn: Any) -> dict[str, Any]:
    device = drawn.device
    return {
        "gain_V_per_m": device.gain_V_per_m,
        "sample_rate_Hz": device.sample_rate_Hz,
        "stiffness_per_s2": device.stiffness,
        "damping_per_s": device.damping,
    }


def _told_in_vain(diagnosis: Diagnosis, bench: Bench, ended: str, hidden: Collection[str]) -> bool:
    """Whether a diagnosis said of what it ended as that no experiment of this bench tells it from what was hidden."""
    left = [pair for pair in diagnosis.separations if pair not in separable(diagnosis, bench)]
    alike = [{plain(pair.effect), plain(pair.with_)} for pair in left]
    return any(ended in pair and pair & set(hidden) for pair in alike)


def _told(diagnosis: Any) -> str:
    names = "+".join(effect.name for effect in diagnosis.effects)
    alike = ", ".join(sorted({pair.with_ for pair in diagnosis.separations}))
    return f"{diagnosis.verdict} {names}" + (f" or {alike}" if alike else "")
