"""The records that are traced: short, of a fixed draw, and of every kind that tracing has a way of its own for."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.thresholds.pieces import in_place_of, pieces
from evaluation.undeclared.population import Order

if TYPE_CHECKING:
    from estimator.trace.problem import Problem

DRAW = 7
FRACTION = 0.6

_TWO_AXES: dict[str, tuple[str, tuple[str, ...], int, int]] = {
    # category, effects, number within the draw, samples
    "clean": ("clean", (), 2, 30_000),
    "drive gain": ("single", ("drive_gain",), 0, 8_000),
    "sense delay": ("single", ("sense_delay",), 0, 8_000),
    "cubic stiffness": ("single", ("cubic_stiffness",), 0, 8_000),
    "friction": ("single", ("dry_friction",), 0, 8_000),
    "line": ("single", ("interference",), 2, 8_000),
    "sense gain": ("single", ("sense_gain",), 2, 8_000),
    "two effects": ("double", ("cubic_stiffness", "sense_gain"), 1, 8_000),
    "calm": ("calm", ("sense_gain",), 1, 8_000),
    "outside": ("outside", ("parametric_stiffness",), 0, 8_000),
}

Answer = dict[str, Any]


def orders() -> dict[str, tuple[Order, int]]:
    """The records that are to be made beforehand, and of how many samples each is."""
    return {
        name: (Order(category, effects, number, DRAW), samples)
        for name, (category, effects, number, samples) in _TWO_AXES.items()
    }


def tracers(folder: Path) -> dict[str, Callable[[], Answer]]:
    """By record, what tracing answers."""
    found: dict[str, Callable[[], Answer]] = {
        name: lambda order=order: _of_axes(_recorded(folder / order.name)) for name, (order, _) in orders().items()
    }
    found |= {
        "single axis, cubic": lambda: _of_axes(_single_axis(1.0)),
        "single axis, clean": lambda: _of_axes(_single_axis(0.0)),
        "single axis, periodic": lambda: _of_axes(_single_axis(1.0, period=150)),
        "ring-down": lambda: _of_axes(_single_axis(1.0, drive=0.0)),
        "pool": _of_pool,
        "pool, a run that is lost": _of_pool_that_loses_a_run,
        "envelope": lambda: _of_envelope(400),
        "envelope, short": lambda: _of_envelope(70),
        "sensor, saturation": lambda: _of_sensor(lambda f: np.clip(0.1 + 2.0 * f, -2.4, 2.6)),
        "sensor, cubic": lambda: _of_sensor(lambda f: 0.1 + 2.0 * (f - 0.02 * f**3)),
        "sensor, line": lambda: _of_sensor(lambda f: 0.1 + 2.0 * f),
        "sensor, moving": _of_moving_sensor,
        "too short": lambda: _refused(folder, lambda problem: problem.part(slice(0, len(problem.record) // 6))),
        "clipped": lambda: _refused(folder, _clipped),
        "lost": lambda: _refused(folder, _lost),
        "still": lambda: _refused(folder, _still),
        "slow": lambda: _refused(folder, _slow),
    }
    return found | pieces()


def _of_axes(problem: "Problem") -> Answer:
    from estimator.errors import ModelError
    from estimator.identification.trace import trace
    from estimator.trace.candidates import kind

    try:
        with np.errstate(all="ignore"):
            found = trace(problem, split=round(FRACTION * len(problem.record)))
    except ModelError as error:
        return {"verdict": f"refused: {str(error).partition(':')[0]}", "words": []}
    named = sorted(kind(effect.name) for effect in found.effects)
    alike = [f"{pair.effect} or {pair.other}: {pair.separate_by}" for pair in found.separations]
    seen = [f"finds {finding.kind}" for finding in found.findings]
    return {"verdict": _said(found.verdict.value, named), "words": sorted({*alike, *seen})}


def _of_sensor(curve: Callable[[Any], Any]) -> Answer:
    from estimator.rate_sensor.declaration import Range
    from estimator.rate_sensor.record import SensorRecord

    declared = Range(math.radians(100.0), 2.0)
    sweeps = (1.0, 1.6, 1.0, 2.0)
    share = np.concatenate([np.linspace(-reach, reach, 11) for reach in sweeps])
    volts = curve(share) + 1e-4 * np.random.default_rng(1).standard_normal(len(share))
    return _traced(SensorRecord(share * declared.rate, volts), declared, 1e-4, np.arange(len(share)) < 33)


def _of_moving_sensor() -> Answer:
    """A first-order lag behind a rate that steps and swings."""
    from scipy.signal import lfilter

    from estimator.rate_sensor.declaration import Range
    from estimator.rate_sensor.record import SensorRecord
    from estimator.rate_sensor.trace import alternate_blocks

    declared, step, lag = Range(math.radians(100.0), 2.0), 1e-3, 0.01
    t = np.arange(4000) * step
    levels = np.random.default_rng(2).uniform(-0.8, 0.8, 40)[(t / 0.1).astype(int)]
    share = np.where(t < 0.1, 0.0, levels + 0.1 * np.sin(2.0 * math.pi * 15.0 * t))
    keeps = math.exp(-step / lag)
    volts = 0.05 + 2.0 * lfilter([1.0 - keeps], [1.0, -keeps], share)
    volts += 1e-3 * np.random.default_rng(3).standard_normal(len(t))
    return _traced(SensorRecord(share * declared.rate, volts, step), declared, 1e-3, alternate_blocks(len(t), 50))


def _traced(record: Any, declared: Any, noise: float, fitting: Any) -> Answer:
    from estimator.errors import ModelError
    from estimator.rate_sensor.trace import trace_sensor

    try:
        found = trace_sensor(record, declared, noise, fitting)
    except ModelError as error:
        return {"verdict": f"refused: {str(error).partition(':')[0]}", "words": []}
    named = sorted(effect.name for effect in found.effects)
    alike = sorted(f"{pair.effect} or {pair.other}: {pair.separate_by}" for pair in found.separations)
    return {"verdict": _said(found.verdict.value, named), "words": alike}


def _said(verdict: str, named: list[str]) -> str:
    return f"{verdict}: {', '.join(named)}" if named else verdict


def _recorded(place: Path) -> "Problem":
    from estimator.trace.problem import Problem
    from hil.bench import load_bench
    from hil.inputs.captured import control_of, drives_of, record_of
    from hil.inputs.declared import device_of, observer_settings_of
    from hil.records.capture import read_capture

    captured, bench = read_capture(place / "capture.arrow"), load_bench(place / "bench.toml")
    device = device_of(bench)
    record = record_of(captured, drives_of(captured, device))
    return Problem(record, device, observer_settings_of(bench), control_of(bench, captured))


def _of_pool() -> Answer:
    """Five ring-downs of an oscillator that hardens and is softened by a load, two of them held out."""
    from estimator.errors import ModelError
    from estimator.trace.pool.members import Member, Pool
    from estimator.trace.pool.trace import trace_pool

    loads, starts = (0.0, 0.1, 0.2, 0.3, 0.4), (0.12, 0.06, 0.09, 0.1, 0.07)
    problems = [
        _single_axis(1.0, drive=0.0, start=start, stiffness=1.92e5 - 2e4 * load, seed=seed)
        for seed, (load, start) in enumerate(zip(loads, starts, strict=True))
    ]
    members = tuple(Member(f"load {load}", problem.record, load) for load, problem in zip(loads, problems, strict=True))
    try:
        with np.errstate(all="ignore"):
            found = trace_pool(Pool(members, problems[0].device, problems[0].settings, "load_kg"), (1, 3))
    except ModelError as error:
        return {"verdict": f"refused: {str(error).partition(':')[0]}", "words": []}
    named = sorted(effect.name for effect in found.effects)
    told = sorted(f"{one.name} depends on {one.covariate}" for one in found.dependences)
    return {"verdict": _said(found.verdict.value, [*named, *told]), "words": []}


def _of_pool_that_loses_a_run() -> Answer:
    """The same, where a fit comes by constants with which a record has no free run, eleven times."""
    from estimator.errors import ModelError
    from estimator.trace.pool import fit

    runs, simulated = 0, fit.simulated

    def sometimes(*given: Any, **more: Any) -> Any:
        nonlocal runs
        runs += bool(more.get("sensitive"))
        if more.get("sensitive") and 40 < runs < 500 and runs % 40 == 0:
            raise ModelError("no free run")
        return simulated(*given, **more)

    with in_place_of(fit, "simulated", sometimes):
        return _of_pool()


def _of_envelope(samples: int) -> Answer:
    """The amplitude, in decibels, of a ring-down with dry friction and drag, from the averages over a cycle."""
    from estimator.envelope.record import Envelope, Resonator
    from estimator.envelope.trace import by_turns, trace_envelope
    from estimator.errors import ModelError
    from estimator.settings import Device

    omega, damping, friction, drag, noise = 2.0 * math.pi * 5.0, 0.6, 2e-3, 40.0, 0.05
    time = np.linspace(0.0, 6.0, samples)
    amplitude, shown, steps = 5e-3, [], 200
    for _ in time:
        shown.append(20.0 * math.log10(amplitude))
        for _ in range(steps):
            lost = 0.5 * damping * amplitude + 2.0 * friction / (math.pi * omega)
            lost += 4.0 / (3.0 * math.pi) * drag * omega * amplitude**2
            amplitude -= lost * (time[1] - time[0]) / steps
    device = Device(
        sample_rate=40.0, stiffness=(omega**2,), damping=(1.2 * damping,), amplitude=5e-3, sense_gain=(1.0,),
        noise=(noise,), sense_unit="dB",
    )  # fmt: skip
    read = np.array(shown) + noise * np.random.default_rng(4).standard_normal(samples)
    resonator = Resonator(device, (1.2 * damping, damping), 1e-4, noise)
    try:
        found = trace_envelope(Envelope(time, read, logarithmic=True), resonator, by_turns(samples))
    except ModelError as error:
        return {"verdict": f"refused: {str(error).partition(';')[0]}", "words": []}
    return {"verdict": _said(found.verdict.value, sorted(effect.name for effect in found.effects)), "words": []}


def _single_axis(
    hardening: float,
    drive: float = 1.5e4,
    period: int = 900,
    *,
    start: float = 0.12,
    stiffness: float = 1.92e5,
    seed: int = 1,
) -> "Problem":
    """An oscillator that is pushed by noise, which may come back, or let go, integrated by Runge and Kutta in steps of
    a fortieth sample.
    """
    from estimator.record import Record
    from estimator.settings import Device, ObserverSettings, Spread
    from estimator.trace.problem import Problem

    rate, samples, parts = 600.0, 900, 40
    device = Device(
        sample_rate=rate, stiffness=(1.9e5,), damping=(40.0,), amplitude=0.1, sense_gain=(2.0,), noise=(1e-4,)
    )
    force = drive * np.resize(np.random.default_rng(3).standard_normal(period), samples)

    def field(state: Any, push: float) -> Any:
        x, v = state
        return np.array([v, push - 41.0 * v - stiffness * x - hardening * 7e5 * x**3])

    state = np.array([0.0 if drive else start, 0.0])
    moved, h = np.zeros(samples), 1.0 / rate / parts
    for n in range(samples):
        for _ in range(parts):
            a = field(state, force[n])
            b = field(state + 0.5 * h * a, force[n])
            c = field(state + 0.5 * h * b, force[n])
            d = field(state + h * c, force[n])
            state = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        moved[n] = state[0]
    sense = 2.0 * moved + 0.004 + 1e-4 * np.random.default_rng(seed).standard_normal(samples)
    record = Record(sense[:, None], force[:, None, None], np.full(samples, 1.0 / rate))
    return Problem(record, device, ObserverSettings(spread=Spread(offset=0.01)))


def _refused(folder: Path, spoilt: Callable[["Problem"], "Problem"]) -> Answer:
    """A clean record made unfit: whether it is refused, and as what. Quick, since nothing is traced."""
    from estimator.errors import ModelError
    from estimator.trace.fitness import require_traceable

    problem = spoilt(_recorded(folder / orders()["clean"][0].name))
    try:
        require_traceable(problem.record, problem.device, round(FRACTION * len(problem.record)))
    except ModelError as error:
        return {"verdict": f"refused: {str(error).partition(':')[0].partition(';')[0]}", "words": []}
    return {"verdict": "fit to be traced", "words": []}


def _clipped(problem: "Problem") -> "Problem":
    sense = problem.record.sense
    top = np.quantile(np.abs(sense), 0.998)
    return problem.on(replace(problem.record, sense=np.clip(sense, -top, top)))


def _lost(problem: "Problem") -> "Problem":
    sense = problem.record.sense.copy()
    sense[np.random.default_rng(1).random(len(sense)) < 0.6] = np.nan
    return problem.on(replace(problem.record, sense=sense))


def _still(problem: "Problem") -> "Problem":
    noise = np.array(problem.device.noise)
    random = np.random.default_rng(1).standard_normal(problem.record.sense.shape)
    return problem.on(replace(problem.record, sense=2.0 * noise * random))


def _slow(problem: "Problem") -> "Problem":
    """Every eighth sample."""
    record = problem.record
    return problem.on(replace(record, sense=record.sense[::8], drive=record.drive[::8], step=8.0 * record.step[::8]))
