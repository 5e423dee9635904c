"""Signatures of a pass against what including a small effect really does to the innovations."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from estimator.effects.catalogue import EFFECTS, effect_for
from estimator.record import Record
from estimator.scaling import Array, Scaling
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant
from estimator.trace.experiments import EXPERIMENTS, loop_record
from estimator.trace.filtered import START_CYCLES, Filtered
from estimator.trace.likelihood import Model, observer_of
from estimator.trace.observed import run
from estimator.trace.problem import Problem
from tests.estimator.whitening import whitener

OMEGA0 = 2 * np.pi * 200.0
K = OMEGA0**2
PARAMETERS = {
    "sense_high_pass": {"leak_x": 10.0, "leak_y": 20.0},
    "sense_clipping": {"level": 0.8e-4},
    "parasitic_mode": {"omega": 3 * OMEGA0, "zeta": 0.02},
    "drive_saturation": {"limit": 0.02e-4 * K},
    "drive_dead_band": {"band": 0.005e-4 * K},
    "interference": {"omega": 777.0},
    "base_vibration": {"omega": 777.0},
    "stribeck_friction": {"vs": 0.8e-4 * OMEGA0},
}
WITHOUT_CHANNEL = ("temperature_stiffness", "temperature_damping", "temperature_offset")
# Beside an offset nothing is left of it but what happens while a velocity turns, which three nodes a step do not see.
HIDDEN = ("dry_friction_asymmetric", *(effect.name for effect in EFFECTS if effect.runs_freely))
"""Also what a free run tells and no observer that is corrected on its way."""
KINKED = (
    "dry_friction",
    "dry_friction_asymmetric",
    "damping_asymmetric",
    "drag",
    "drag_radial",
    "dry_friction_radial",
    "stribeck_friction",
)  # three nodes a step see them coarsely

DEVICE = Device(
    sample_rate=4000.0,
    stiffness=(K * 1.02, K * 0.98, K * 0.01),
    damping=(1.3, 1.1, 0.06),
    amplitude=1e-4,
    sense_gain=(-890.0, -890.0),
    noise=(9e-5, 9e-5),
    target_stiffness=K,
)
SETTINGS = ObserverSettings(
    gain=Gain.EKF,
    spread=Spread(offset=1e-3, rate=0.1, stiffness=1e-4, damping=0.01),
    process_noise=ProcessNoise(rate=0.5),
    initial={"x": 1e-4, "vx": 0.0},
)


@cache
def record() -> Record:
    """Everything excited at once, no noise."""
    everything = next(experiment for experiment in EXPERIMENTS if experiment.name == "all")
    return loop_record(everything, DEVICE, SETTINGS, latency=1, noise=0.0)


@cache
def white() -> Array:
    """(n, axes, axes): what makes the innovations of the record white."""
    return whitener(DEVICE, replace(SETTINGS, variant=Variant.SENSE), record().sense, record().drive)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [effect.name for effect in EFFECTS if not effect.declared_only and effect.name not in (*WITHOUT_CHANNEL, *HIDDEN)],
)
def test_a_signature_is_what_including_the_effect_does_to_the_innovations(name: str) -> None:
    """The information that a pass has of a coefficient is the power of the change, whitened."""
    given = PARAMETERS.get(name, {})
    problem = Problem(record(), DEVICE, SETTINGS)
    of = Filtered(problem)
    layout, noise = of.layout({}), of.declared_noise()
    seen = of.evaluate(layout, Model({}, layout.mean, noise), derivatives=False, tested={name: given})
    without = run(observer_of(problem, {}, noise), record()).innovation
    _, effect = effect_for(name, 2)
    start = int(np.ceil(START_CYCLES * 2.0 * np.pi / (OMEGA0 / DEVICE.sample_rate)))
    scaling = Scaling.of(DEVICE)
    for column, (coefficient, plausible) in enumerate(zip(effect.coefficients, of.plausible(name), strict=True)):
        small = 1e-4 * plausible * scaling.coefficient(coefficient)
        including = observer_of(problem, {name: {**given, coefficient.name: small}}, noise)
        moved = (run(including, record()).innovation - without) / 1e-4
        expected = np.sum(np.einsum("nab,nb->na", white(), moved)[start:] ** 2)
        information = float(seen.information[:, column, column].sum()) * plausible**2
        assert information == pytest.approx(expected, rel=0.1 if name in KINKED else 0.01, abs=0.05)
