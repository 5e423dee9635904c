"""Effects of one's own beside those of the catalogue of the same form: what a step costs, and the angle error left.

Cost: observers with the one and with the other run over the same record by turns, in the processor's time of this
thread; the ratio is the median of those of the turns.  Each is declared as a bench file declares it, and one is brought
by a package as well, through its entry point.  Angle: the cubic stiffness that the board of s-undeclared hides,
once undone by the catalogue's effect and once by the same law as text, both as `hil trace` found it on the record of
the run before.
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.compensation import angle_error, traced
from benchmarks.lockstep import close_loop
from benchmarks.row import Row, Say
from device_emulator.scenario import load
from estimator.core.own import address, is_compiled
from estimator.custom import Coefficient, Declaration
from estimator.custom.building import built
from estimator.effects.declaration import Effect
from estimator.model.catalogue import model_for
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, ObserverSettings
from hil.bench import load_bench, override
from hil.bench.examples import find
from hil.inputs.own_effects import own_effects

SAMPLES, TURNS, TICKS = 20_000, 15, 4_000
LOOP_SAMPLES, SEED = 96_000, 1
OMEGA0 = 2.0 * np.pi * 200.0
CONTROLLER = ControllerSettings(latency=1, force_quantum=1e-4, force_limit=10.0, sense_quantum=1e-6)
CUBIC = Declaration(
    "cubic_as_text",
    force=("-px * x**3", "-py * y**3"),
    coefficients={"px": Coefficient("1/(m²·s²)"), "py": Coefficient("1/(m²·s²)")},
)
PACKAGED = replace(CUBIC, name="cubic_of_a_package")
ALIKE = {
    "cubic_stiffness": CUBIC,
    "cubic_isotropic": Declaration(
        "cubic_along_the_radius", force=("-p * r**2 * x", "-p * r**2 * y"), coefficients={"p": Coefficient("1/(m²·s²)")}
    ),
    "drag": Declaration(
        "drag_as_text",
        force=(
            "-px * vx**2 * tanh(vx / (0.01 * amplitude * omega0))",
            "-py * vy**2 * tanh(vy / (0.01 * amplitude * omega0))",
        ),
        coefficients={"px": Coefficient("1/m"), "py": Coefficient("1/m")},
    ),
    "dry_friction": Declaration(
        "friction_as_text",
        force=("-px * sign(vx)", "-py * sign(vy)"),
        coefficients={"px": Coefficient("m/s²"), "py": Coefficient("m/s²")},
    ),
    "sense_quadratic": Declaration(
        "sense_as_text",
        sense=("px * x**2", "py * y**2"),
        coefficients={"px": Coefficient("1/m"), "py": Coefficient("1/m")},
    ),
}


def rows(say: Say) -> list[Row]:
    """Cost of a sample of a record and of a tick of the loop for each form, time to compile, angle error."""
    figures = []
    sense, drive = _record()
    plain = _device()
    _, model = model_for(2)
    for name, declared, effect in _effects(plain):
        known, begin = is_compiled(effect, model), time.perf_counter()
        address(effect, model)
        if not known:
            figures.append(Row(f"{name}: first compilation of the law", time.perf_counter() - begin, "s"))
        own = replace(plain, own=(effect,))

        ours, theirs = partial(_observer, own, declared.name), partial(_observer, plain, name)
        for what, work in (("sample of a record", _over_record), ("tick of the loop", _ticking)):
            cost, ratio = _by_turns(partial(work, sense, drive), ours, theirs)
            figures.append(Row(f"{name} as {declared.name}: {what}", cost * 1e6, "µs", "catalogue", ratio))
            say(f"{name} as {declared.name}: {what} {cost * 1e6:.2f} µs, {ratio:.3f} × that of the catalogue")
    return figures + _angle(say)


def _effects(device: Device) -> Iterator[tuple[str, Declaration, Effect]]:
    """The catalogue's name, what is declared in its place, and the effect of it: from text, and from a package."""
    scaling = Observer(device, ObserverSettings()).scaling
    for name, declared in ALIKE.items():
        yield name, declared, built(declared, scaling, 2)
    with _installed(PACKAGED):
        (effect,) = own_effects(load_bench(find("bench", "s-slow")), device)
    yield "cubic_stiffness", PACKAGED, effect


@contextmanager
def _installed(declared: Declaration) -> Iterator[None]:
    """A package whose entry point leads to `declared`, as pip would leave it."""
    with TemporaryDirectory() as site:
        folder = Path(site) / "one_effect-1.0.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: one-effect\nVersion: 1.0.0\n")
        (folder / "entry_points.txt").write_text(f"[hil.effects]\n{declared.name} = {__name__}:PACKAGED\n")
        sys.path.insert(0, site)
        try:
            yield
        finally:
            sys.path.remove(site)


def _observer(device: Device, carried: str) -> Observer:
    return Observer(device, ObserverSettings(effects={carried: {}}), CONTROLLER)


def _over_record(sense: Array, drive: Array, observer: Observer) -> int:
    observer.run(sense, drive)
    return len(sense)


def _ticking(sense: Array, drive: Array, observer: Observer) -> int:
    for (zx, zy), (ux, uy) in zip(sense[:TICKS].tolist(), drive[:TICKS].tolist(), strict=True):
        observer.tick(zx, zy, ux, uy)
    return TICKS


def _by_turns(
    work: Callable[[Observer], int], ours: Callable[[], Observer], theirs: Callable[[], Observer]
) -> tuple[float, float]:
    """Seconds a sample of ours, median; median ratio to theirs of the same turn, who is first by turns."""
    costs: list[tuple[float, float]] = []
    for turn in range(TURNS + 1):
        pair = [0.0, 0.0]
        for which in (0, 1) if turn % 2 else (1, 0):
            observer = (ours, theirs)[which]()
            begin = time.thread_time()
            done = work(observer)
            pair[which] = (time.thread_time() - begin) / done
        costs.append((pair[0], pair[1]))
    measured = np.array(costs[1:])  # the first loads code
    return float(np.median(measured[:, 0])), float(np.median(measured[:, 0] / measured[:, 1]))


def _device() -> Device:
    return Device(
        sample_rate=4000.0,
        stiffness=(1.02 * OMEGA0**2, 0.98 * OMEGA0**2, 0.01 * OMEGA0**2),
        damping=(1.3, 1.1, 0.06),
        amplitude=1e-4,
        sense_gain=(-890.0, -890.0),
        noise=(1e-4, 1e-4),
        target_stiffness=OMEGA0**2,
    )


def _record() -> tuple[Array, Array]:
    rng = np.random.default_rng(1)
    t = np.arange(SAMPLES) / 4000.0
    swing = np.stack([np.cos(OMEGA0 * t) * np.cos(2.0 * t), np.cos(OMEGA0 * t) * np.sin(2.0 * t)], axis=1)
    return -0.089 * swing + 1e-4 * rng.standard_normal(swing.shape), rng.choice([-0.3, 0.3], swing.shape)


def _angle(say: Say) -> list[Row]:
    """The loop of s-undeclared without the effect, with the catalogue's, and with the same as text."""
    scenario, bench = load(find("scenario", "s-undeclared")), load_bench(find("bench", "s-undeclared"))
    before = close_loop(scenario, bench, LOOP_SAMPLES, seed=SEED)
    found = traced(before, bench)
    k3x, k3y = found["cubic_stiffness"]["k3x"], found["cubic_stiffness"]["k3y"]
    custom = {
        CUBIC.name: {
            "force_x": CUBIC.force[0],
            "force_y": CUBIC.force[1],
            "coefficients": {
                "px": {"unit": CUBIC.coefficients["px"].unit, "start": k3x},
                "py": {"unit": CUBIC.coefficients["py"].unit, "start": k3y},
            },
        }
    }
    catalogue = close_loop(scenario, override(bench, {"effects": found}, "found"), LOOP_SAMPLES, seed=SEED)
    own = close_loop(scenario, override(bench, {"effects": {"custom": custom}}, "own"), LOOP_SAMPLES, seed=SEED)
    without, theirs, ours = angle_error(before), angle_error(catalogue), angle_error(own)
    say(f"s-undeclared: angle error rms {without:.4g} rad, {theirs:.4g} with the catalogue's, {ours:.4g} as text")
    return [
        Row("s-undeclared: angle error rms without the effect", without, "rad"),
        Row("s-undeclared: angle error rms with the catalogue's", theirs, "rad", "without", theirs / without),
        Row("s-undeclared: angle error rms with the law as text", ours, "rad", "catalogue", ours / theirs),
    ]
