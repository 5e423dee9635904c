"""`python -m evaluation.pools`: several records of one drawn device traced together, judged by what was drawn.

Devices, effects and boards of two axes are those of `evaluation.undeclared`; of one axis, oscillators that SciPy solves
(`evaluation.pools_alone`).  Each record has its own rate and noise.  What differs
between the records of a pool, by its kind: nothing; the amplitude; a temperature that moves the stiffness, which each
record carries as a number; or one record is of another device.
"""

import argparse
import json
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.lockstep import close_loop
from device_emulator.scenario import Scenario
from estimator.diagnosis import Diagnosis, Interval, Verdict
from estimator.side_by_side import one_blas_thread
from estimator.trace.pool import Member, Pool, held_out_by_default
from estimator.trace.pool_trace import trace_pool
from evaluation.pools_alone import alone
from evaluation.undeclared.device import draw_rate
from evaluation.undeclared.expected import expected
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import Drawn, draw_record, write_capture
from hil.bench import override
from hil.inputs.captured import drives_of, record_of
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.records.capture import read_capture

SAMPLES = 12_000
"""Of a record."""
SOFTER = -6e-5
"""1/K, of the stiffness: silicon."""
HIDDEN = (
    *("cubic_stiffness", "drive_gain", "sense_gain", "nonlinear_damping", "dry_friction", "sense_cubic"),
    *("sense_delay", "drive_misalignment", "quadratic_stiffness", "drive_delay", "sense_cross_coupling"),
)
KINDS = ("effect by amplitude", "nothing", "temperature", "another device", "effect at one amplitude", "effect warm")


class Drawing(NamedTuple):
    """A pool: its kind, the effect hidden in all its records or "", its records; what was drawn of coefficients, and of
    slopes by constant.
    """

    kind: str
    effect: str
    pool: Pool
    truth: Mapping[str, float]
    slopes: Mapping[str, float]


def drawing(number: int, seed: int, folder: Path) -> Drawing:
    """The pool of two axes of that number; its captures are left in `folder`."""
    kind = KINDS[number % len(KINDS)]
    effect = HIDDEN[number % len(HIDDEN)] if kind.startswith("effect") else ""
    order = Order("single" if effect else "clean", (effect,) if effect else (), number, seed)
    rng = np.random.default_rng([seed, number])
    drawn = draw_record(order, SAMPLES)
    count = int(rng.integers(3, 7))
    covariate = "temp_K" if kind in ("temperature", "effect warm") else None
    members = []
    for i in range(count):
        warm = float(np.linspace(-30.0, 30.0, count)[i]) if covariate else 0.0
        share = float(np.linspace(0.6, 1.1, count)[i]) if kind == "effect by amplitude" else 1.0
        table = _table(drawn, rng, warm, share, other=kind == "another device" and i == count // 2)
        scenario = Scenario.model_validate(table)
        bench = override(drawn.bench, {"device": {"amplitude_m": share * drawn.device.amplitude_m}}, "drawn")
        loop = close_loop(scenario, bench, SAMPLES, seed=order.seed % 2**31 + i, every=1000)
        path = folder / f"{number:02d}-{i}.arrow"
        path.unlink(missing_ok=True)
        write_capture(path, loop, scenario, None)
        captured = read_capture(path)
        device = recorded_device_of(drawn.bench, captured)
        members.append(Member(f"record {i}", record_of(captured, drives_of(captured, device)), warm))
    pool = Pool(tuple(members), device, observer_settings_of(drawn.bench), covariate)
    kxx, kyy, _ = drawn.device.stiffness
    slopes = {"kxx": SOFTER * kxx, "kyy": SOFTER * kyy} if covariate else {}
    return Drawing(kind, effect, pool, _truth(drawn, effect), slopes)


def drawing_alone(number: int, seed: int) -> Drawing:
    """The pool of one axis of that number."""
    one = alone(number, seed)
    pool = Pool(tuple(Member(*record) for record in one.records), one.device, one.settings, one.covariate)
    slopes = {name: value for name, value in one.truth.items() if name == "kxx"}
    truth = {name: value for name, value in one.truth.items() if name != "kxx"}
    return Drawing(one.kind, one.effect, pool, truth, slopes)


def _truth(drawn: Drawn, effect: str) -> Mapping[str, float]:
    """Coefficients of the effect that was drawn."""
    if not effect:
        return {}
    device, hidden = drawn.device, drawn.hidden[0]
    sheet = {
        "gain_V_per_m": device.gain_V_per_m, "amplitude_m": device.amplitude_m,
        "stiffness_per_s2": device.stiffness, "sample_rate_Hz": device.sample_rate_Hz,
    }  # fmt: skip
    return expected(effect, hidden.effects, hidden.sections, sheet).coefficients


def _table(drawn: Drawn, rng: np.random.Generator, warm: float, share: float, *, other: bool) -> dict[str, Any]:
    """The scenario of one record."""
    table: dict[str, Any] = json.loads(json.dumps(drawn.table))
    truth = table["truth"]
    table["rate"] = draw_rate(rng, drawn.device, SAMPLES / drawn.device.sample_rate_Hz)
    truth["stiffness_N_per_m"] = [k * (1.0 + SOFTER * warm) for k in truth["stiffness_N_per_m"]]
    truth["position_m"] = [share * x for x in truth["position_m"]]
    if other:
        truth["stiffness_N_per_m"] = [
            k * s for k, s in zip(truth["stiffness_N_per_m"], (1.004, 0.997, 1.3), strict=True)
        ]
        truth["damping_N_s_per_m"] = [d * 1.2 for d in truth["damping_N_s_per_m"]]
    return table


def covered(one: Drawing, found: Diagnosis) -> Iterator[bool]:
    """Whether each interval that is told covers what was drawn."""
    for effect in found.effects:
        if effect.name == one.effect:
            told = effect.coefficients
            yield from (_within(told[name], value) for name, value in one.truth.items() if name in told)
    for goes in found.dependences:
        if goes.name in one.slopes:
            yield _within(goes.slope, one.slopes[goes.name])


def _within(interval: Interval, value: float) -> bool:
    return interval.low <= value <= interval.high


def right(one: Drawing, found: Diagnosis) -> bool:
    """Whether the word is right, and what is named is what was drawn or a member of its group."""
    named = {effect.name for effect in found.effects}
    groups = {name for group in found.ambiguity_groups for name in group}
    if one.kind == "another device":
        return found.verdict.is_open
    if one.effect and not (one.effect in named | groups and len(named) == 1):
        return False
    if not set(one.slopes) <= {goes.name for goes in found.dependences}:
        return False
    return found.verdict is (Verdict.EXPLAINED if one.effect or one.slopes else Verdict.ADEQUATE)


def main() -> int:
    """Draw, trace, judge, print; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.pools", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of the draws (default 1)")
    parser.add_argument("--pools", type=int, default=12, help="how many (default 12)")
    parser.add_argument("--first", type=int, default=0, help="number of the first (default 0)")
    parser.add_argument("--axes", type=int, choices=[1, 2], default=2, help="of the devices (default 2)")
    parser.add_argument(
        "--folder", type=Path, default=Path("pools"), help="of the captures of two axes (default pools)"
    )
    options = parser.parse_args()
    if options.axes == 2:
        options.folder.mkdir(parents=True, exist_ok=True)
    counts: Mapping[str, list[bool]] = {"right": [], "intervals": []}
    for number in range(options.first, options.first + options.pools):
        two = options.axes == 2
        one = drawing(number, options.seed, options.folder) if two else drawing_alone(number, options.seed)
        begin = time.process_time()
        with one_blas_thread(), np.errstate(all="ignore"):
            found = trace_pool(one.pool, held_out_by_default(one.pool))
        seconds, within = time.process_time() - begin, list(covered(one, found))
        counts["right"].append(right(one, found))
        counts["intervals"].extend(within)
        named = ", ".join(
            [effect.name for effect in found.effects] + [f"{d.name} by {d.covariate}" for d in found.dependences]
        )
        print(
            f"{number:2d} {one.kind}{': ' * bool(one.effect)}{one.effect} | {len(one.pool.members)} records | "
            f"{found.verdict.value}{': ' * bool(named)}{named} | {'right' if counts['right'][-1] else 'WRONG'} | "
            f"{sum(within)}/{len(within)} | {seconds:.1f} s",
            flush=True,
        )  # fmt: skip
        if not counts["right"][-1]:
            print(*(f"     {reason}" for reason in found.reasons), sep="\n", flush=True)
    print({name: f"{sum(values)} of {len(values)}" for name, values in counts.items()})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
