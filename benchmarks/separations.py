"""Do experiments tell look-alikes apart?  Calm devices that leave several accounts, and `hil trace --live` on each.

A device of the undeclared campaign lies still: no rate, no virtual rotation, no dither, no modulation.  Its record is
traced.  Where the diagnosis lists look-alikes that an experiment of the bench would tell apart, the experiments are
made on the same emulated board, as `--live` makes them, until none is proposed; the last diagnosis must name what was
hidden, first.  Where an experiment is to turn the gyro, which no host can, it is turned as the records of the campaign
are: the rate goes through a few cycles in as long as one of those takes, however short the record is here, since who
turns a gyro turns it no faster for a short record.  Devices whose record tells everything, or nothing, are counted
beside them.

Results are kept in runs/separations, one file a device; what is there is not run again.  SEPARATIONS_DRAW is another
draw, SEPARATIONS of how many devices to make experiments, SEPARATIONS_JOBS how many processes, SEPARATIONS_SAMPLES how
long the first record is: the shorter, the more is left to experiments.
"""

import json
import os
import shutil
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.row import Row, Say
from benchmarks.verdicts.campaign import toml_of
from estimator.side_by_side import one_worker_each
from estimator.trace.separation import Experiment
from evaluation.undeclared.device import draw_rate
from evaluation.undeclared.effects import DRAWABLE
from evaluation.undeclared.expected import expected
from evaluation.undeclared.judging import class_of, plain
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import SAMPLES as CAMPAIGN_SAMPLES
from evaluation.undeclared.record import draw
from hil.bench import override
from hil.loop.run import run
from hil.records.atomic import write_text
from hil.records.runfolder import RunFolder
from hil.separate import separable, separate
from hil.tracing import trace

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
        while sum(one["experiments"] > 0 for one in done) < wanted:
            for one in pool.map(partial(_one, samples), [next(orders) for _ in range(2 * jobs)]):
                done.append(one)
                say(f"{one['name']}: {one['before']}; {one['experiments']} experiments; {one['after']}")
    tried = [one for one in done if one["experiments"]]
    return [
        Row("calm devices", len(done), "1"),
        Row("… an experiment proposed and made", len(tried), "1"),
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
    drawn = draw(order, samples)
    scenario = place / "device.scenario.toml"
    write_text(scenario, toml_of(drawn.table))
    bench = override(drawn.bench, {"loop": {"name": order.name.replace("_", "-")}}, order.name)
    link = f"inproc:{scenario}"
    folder = run(bench, link, place, progress=lambda _: None).folder
    assert folder is not None
    first = trace(RunFolder(folder).capture_path, bench, place, report=False, progress=lambda _: None).diagnosis
    cycles_s = CAMPAIGN_SAMPLES / drawn.device.sample_rate_Hz
    rate = draw_rate(np.random.default_rng(order.seed + 1), drawn.device, cycles_s)

    def on_the_table(experiment: Experiment, words: str) -> None:
        """What the one who stands at the bench does before the board is armed."""
        turned = {**drawn.table, "rate": rate} if experiment.turning else drawn.table
        write_text(scenario, toml_of(turned))

    made = separate(
        first, bench, link, place, fraction=None, before_run=on_the_table, progress=lambda _: None
    ) if separable(first) else ()  # fmt: skip
    last = made[-1].traced.diagnosis if made else first
    tables, sections = drawn.hidden[0].effects, drawn.hidden[0].sections
    names = expected(order.effects[0], tables, sections, _device(drawn)).names
    named = [plain(effect.name) for effect in last.effects]
    pairs = [pair.model_dump(by_alias=True) for pair in last.confusable]
    explained = last.verdict == "explained" and bool(named)
    right = explained and named[0] in names
    answer = {
        "name": order.name,
        "kind": order.effects[0],
        "before": _told(first),
        "experiments": len(made),
        "after": _told(last),
        "right": right,
        "wrong": explained and not class_of(named[0], pairs) & set(names),
    }
    write_text(kept, json.dumps(answer, indent=1))
    shutil.rmtree(place)
    return answer


def _device(drawn: Any) -> dict[str, Any]:
    device = drawn.device
    return {
        "gain_V_per_m": device.gain_V_per_m,
        "sample_rate_Hz": device.sample_rate_Hz,
        "stiffness_per_s2": device.stiffness,
        "damping_per_s": device.damping,
    }


def _told(diagnosis: Any) -> str:
    names = "+".join(effect.name for effect in diagnosis.effects)
    alike = ", ".join(sorted({pair.with_ for pair in diagnosis.confusable}))
    return f"{diagnosis.verdict} {names}" + (f" or {alike}" if alike else "")
