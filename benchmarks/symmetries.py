"""Each symmetry of the equations on clean records and on records with an effect of the catalogue: is the cause listed?

The board has the changed clock, channel, frame or mass; what it records under the reference excitation is traced with
the data sheet, as `hil trace` does.  Nobody could tell the cause from its equivalents, so it has to be among them:
named, or a look-alike of what is named.  Where the change turns a channel round, no loop would hold, so the run that
records declares it and the trace does not.  Records and answers are kept in a folder and made once; `SYMMETRIES`
replaces it, `SYMMETRIES_ONLY` takes those whose name contains it, `SYMMETRIES_JOBS` is how many are traced at once.
"""

import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lockstep import close_loop
from benchmarks.row import Row, Say
from device_emulator.scenario import Scenario
from evaluation.undeclared.device import bench_table, draw_device, draw_rate, scenario_table
from evaluation.undeclared.judging import class_of, plain
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import write_capture
from evaluation.undeclared.tracing import trace_all
from hil.bench import Bench, override
from hil.bench.template import template, values_of
from hil.records.atomic import write_text
from hil.toml.reading import parse_table

SAMPLES, DRAW = 24_000, 1
FOLDER = Path("runs/symmetries")
ANGLE = 0.03
DELAY = 0.05  # rad of the vibration

REFUSED: dict[str, Any] = {"verdict": "refused", "effects": [], "ambiguity_groups": [], "reasons": []}

Tables = list[dict[str, Any]]


@dataclass(frozen=True)
class Symmetry:
    """A change of the board; `cause`: what the trace calls it; `equivalents`: all that is the same; `declared`: what
    the recording run knows of it.
    """

    name: str
    cause: str
    equivalents: frozenset[str]
    effects: Callable[[float], Tables] = lambda omega: []
    clock_skew: float = 0.0
    backwards: bool = False
    declared: dict[str, dict[str, float]] = field(default_factory=dict)


def _one(name: str, **coefficients: float) -> Callable[[float], Tables]:
    return lambda omega: [{"name": name, **coefficients}]


def _late(name: str, *symbols: str) -> Callable[[float], Tables]:
    return lambda omega: [{"name": name} | dict.fromkeys(symbols, DELAY / omega)]


def _turned(own: str) -> Callable[[float], Tables]:
    """A frame turned by `ANGLE`, exactly."""
    cosine, sine = math.cos(ANGLE), math.sin(ANGLE)
    if own == "sense":
        coupling = {"name": "sense_cross_coupling", "ex": sine, "ey": -sine}
    else:
        coupling = {"name": "drive_misalignment", "mx": sine / cosine, "my": -sine / cosine}
    symbols = ("gx", "gy") if own == "sense" else ("hx", "hy")
    return lambda omega: [{"name": f"{own}_gain"} | dict.fromkeys(symbols, cosine - 1.0), coupling]


_SCALE = frozenset({"drive_gain", "clock_rate", "mass_scale", "sense_scale"})
_SIGN = frozenset({"drive_polarity", "sense_polarity"})
_FRAME = frozenset({"sense_cross_coupling", "drive_misalignment"})
_DELAY = frozenset({"sense_delay", "drive_delay"})


def _polarity(channel: str, **axes: float) -> Symmetry:
    which = "both" if len(axes) == 2 else next(iter(axes))[1]
    name = f"{channel}_polarity"
    return Symmetry(f"{channel}-sign-{which}", name, _SIGN, _one(name, **axes), declared={name: axes})


SYMMETRIES = (
    Symmetry("clock-slow", "clock_rate", _SCALE, clock_skew=-0.012),
    Symmetry("drive-scale", "drive_gain", _SCALE, _one("drive_gain", hx=0.03, hy=0.03)),
    Symmetry("sense-scale", "sense_scale", _SCALE, _one("sense_gain", gx=0.04, gy=0.04)),
    _polarity("drive", px=1.0),
    _polarity("drive", px=1.0, py=1.0),
    _polarity("sense", py=1.0),
    _polarity("sense", px=1.0, py=1.0),
    Symmetry("sense-turned", "sense_cross_coupling", _FRAME, _turned("sense")),
    Symmetry("drive-turned", "drive_misalignment", _FRAME, _turned("drive")),
    Symmetry("backwards", "time_reversal", frozenset({"time_reversal"}), backwards=True),
    Symmetry("masses", "unequal_masses", frozenset({"unequal_masses"}), _one("unequal_masses", m=0.06)),
    Symmetry("sense-late", "sense_delay", _DELAY, _late("sense_delay", "tsx", "tsy")),
    Symmetry("drive-late", "drive_delay", _DELAY, _late("drive_delay", "tux", "tuy")),
)

BESIDE = ("cubic_stiffness", "sense_quadratic", "nonlinear_damping")
"""What is hidden in the records that are not clean, one each."""


@dataclass(frozen=True)
class Case:
    """One record: a symmetry applied to a device, with an effect of the catalogue or without."""

    symmetry: Symmetry
    device: int
    beside: str | None

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.symmetry.name}-{self.beside or 'clean'}-{self.device}"


def cases() -> list[Case]:
    """Every symmetry on three clean devices and three with an effect, in turn: the first are a fair sample."""
    bases = [
        (2 * number + extra, beside if extra else None) for number, beside in enumerate(BESIDE) for extra in (0, 1)
    ]
    return [Case(symmetry, number, beside) for number, beside in bases for symmetry in SYMMETRIES]


def make(case: Case, folder: Path) -> Path:
    """Record one case below `folder` unless it is there already; returns its folder."""
    place = folder / case.name
    if (place / "truth.json").exists():
        return place
    order = Order("symmetry", (case.beside,) if case.beside else (), case.device, DRAW)
    rng = np.random.default_rng(order.seed)
    device = draw_device(rng, crest=1.3, slow=True)
    duration_s = SAMPLES / device.sample_rate_Hz
    table = scenario_table(device, draw_rate(rng, device, duration_s), order.seed)
    a, k = device.amplitude_m, device.omega**2
    hidden: dict[str, dict[str, Any]] = {
        "cubic_stiffness": {"k3x": 0.03 * k / a**2, "k3y": 0.02 * k / a**2},
        "sense_quadratic": {"a2x": 0.01 / a, "a2y": -0.006 / a},
        "nonlinear_damping": {"d3x": 1.5e-3 * device.omega / a**2, "d3y": 1e-3 * device.omega / a**2},
    }
    own = [] if case.beside is None else [{"name": case.beside, **hidden[case.beside]}]
    table["effect"] = own + case.symmetry.effects(device.omega)
    table["faults"] = {"clock_skew": case.symmetry.clock_skew}
    scenario = Scenario.model_validate(table)
    sheet = bench_table(device, duration_s, excited=True, turning=True)
    bench = parse_table(sheet, Bench, case.name)
    knowing = override(bench, {"effects": case.symmetry.declared}, case.name)
    loop = close_loop(scenario, knowing, SAMPLES, seed=order.seed, every=1000)
    if case.symmetry.backwards:
        loop = replace(loop, capture=backwards(loop.capture))
    place.mkdir(parents=True, exist_ok=True)
    write_capture(place / "capture.arrow", loop, scenario, None)
    write_text(place / "bench.toml", template(values_of(bench), "The data sheet."))
    truth = {"cause": case.symmetry.cause, "equivalents": sorted(case.symmetry.equivalents), "beside": case.beside}
    write_text(place / "truth.json", json.dumps(truth | {"scenario": table}, indent=1))
    return place


def backwards(capture: np.ndarray[Any, np.dtype[np.int64]]) -> np.ndarray[Any, np.dtype[np.int64]]:
    """The record (n, 6) of tick, sense, drive and flags in reverse order; a row's drive acted over the interval that
    ends there, which now begins there.
    """
    turned = capture[::-1].copy()
    turned[:, 0] = capture[:, 0]
    turned[0, 3:] = 0
    turned[1:, 3:] = capture[::-1][:-1, 3:]
    return turned


def listed(said: dict[str, Any]) -> set[str]:
    """The named effects and all that the diagnosis says they may be as well; that a record may run backwards is said
    among the reasons, since nothing else is the matter with it.
    """
    named = [plain(effect["name"]) for effect in said["effects"]]
    members = set().union(*(class_of(name, said["ambiguity_groups"]) for name in named))
    if any(reason.startswith("it may run backwards") for reason in said["reasons"]):
        members.add("time_reversal")
    return members


def rows(say: Say) -> list[Row]:
    """In how many of the records the cause is listed, and every equivalent of it."""
    folder, only = Path(os.environ.get("SYMMETRIES", FOLDER)), os.environ.get("SYMMETRIES_ONLY", "")
    chosen = [case for case in cases() if only in case.name]
    places = [make(case, folder) for case in chosen]
    say(f"{len(places)} records")
    trace_all(places, int(os.environ.get("SYMMETRIES_JOBS", "2")), keep=False, say=say)
    found: dict[str, list[tuple[bool, bool, bool]]] = {}
    for case, place in zip(chosen, places, strict=True):
        path = place / "diagnosis.json"
        said = json.loads(path.read_text()) if path.exists() else REFUSED
        members = listed(said)
        held = case.symmetry.cause in members
        found.setdefault(case.symmetry.name, []).append(
            (held, case.symmetry.equivalents <= members, case.beside is None or case.beside in members)
        )
        named = " + ".join(effect["name"] for effect in said["effects"])
        say(f"{'lists' if held else 'MISSES'} {case.name}: {said['verdict']} {named}; {', '.join(sorted(members))}")
    figures = []
    for name, all_ in [*found.items(), ("all", [one for each in found.values() for one in each])]:
        figures.append(Row(f"{name}: records", len(all_), "records"))
        figures.append(Row(f"{name}: cause named or listed", sum(one[0] for one in all_), "records"))
        figures.append(Row(f"{name}: every equivalent named or listed", sum(one[1] for one in all_), "records"))
        figures.append(Row(f"{name}: effect beside it named or listed too", sum(one[2] for one in all_), "records"))
    return figures
