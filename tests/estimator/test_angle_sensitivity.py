"""The angle's sensitivity that a scan follows, against what carrying a small effect really does to the angle."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.completeness.turning import followed, instants
from estimator.effects.catalogue import EFFECTS, effect_for
from estimator.observer import Observer
from estimator.scaling import Array, Scaling
from estimator.settings import ControllerSettings, Gain, ObserverSettings
from estimator.trace.observed import run
from estimator.trace.problem import Problem
from tests.estimator.core_pieces import pattern, piece
from tests.estimator.test_scan import DEVICE, HIDDEN, OMEGA0, PARAMETERS, SETTINGS, WITHOUT_CHANNEL, K, record

CONTROLLER = ControllerSettings(
    latency=1,
    force_quantum=1e-6 * 1e-4 * K,
    force_limit=1e-3 * K,
    sense_quantum=1e-5,
    virtual_rotation=2e-3 * OMEGA0,
)
FADING = replace(SETTINGS, gain=Gain.FADING, memory=0.2)
# What turns over smoothly within a hundredth of the speed is seen coarsely by three nodes a step, and moves the angle
# by microradians at its plausible size.
COARSE = (*HIDDEN, "damping_asymmetric")
SMALL = 1e-4  # of the plausible size
LEAST = 1e-4  # rad at the plausible size: below it the difference of two runs is rounding
NAMES = [
    effect.name for effect in EFFECTS if not effect.declared_only and effect.name not in (*WITHOUT_CHANNEL, *COARSE)
]


def carried(name: str, settings: ObserverSettings, sizes: dict[str, float]) -> Array:
    """Angle (n,) with the effect held at these coefficients."""
    observer = Observer(DEVICE, replace(settings, effects={name: {**PARAMETERS.get(name, {}), **sizes}}), CONTROLLER)
    observer.hold_coefficients()
    return run(observer, record()).angle


@pytest.mark.beyond(len(NAMES))
@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("settings", [SETTINGS, FADING], ids=["ekf", "fading"])
def test_the_angle_moves_as_the_scan_says(name: str, settings: ObserverSettings) -> None:
    problem = Problem(record(), DEVICE, settings, CONTROLLER)
    _, course = followed(problem, {name: PARAMETERS.get(name, {})})
    at = instants(len(record()))
    _, effect = effect_for(name, 2)
    none = {c.name: 0.0 for c in effect.coefficients}
    without = carried(name, settings, none)
    for column, coefficient in enumerate(effect.coefficients):
        plausible = coefficient.plausible * Scaling.of(DEVICE).coefficient(coefficient)
        size = SMALL * plausible
        moved = (carried(name, settings, {**none, coefficient.name: size}) - without)[at] / SMALL
        said = course[:, column] * plausible
        off = np.sqrt(np.mean((said - moved) ** 2))
        assert off < 0.05 * np.sqrt(np.mean(moved**2)) + LEAST, coefficient.name


def test_the_gradient_of_the_pattern_is_that_of_its_angle() -> None:
    random = np.random.default_rng(5)
    for _ in range(20):
        s, virtual, rate = random.standard_normal(4), 0.02, 0.01 * random.standard_normal()
        got = np.zeros(5)
        piece("p_gradient", s, 1.1, rate + virtual, rate, got)
        for i in range(5):
            ends = []
            for side in (-1e-6, 1e-6):
                moved, r = s.copy(), rate
                if i < 4:
                    moved[i] += side
                else:
                    r += side
                ends.append(0.5 * pattern(moved, 1.1, r + virtual, r)[0])
            step = (ends[1] - ends[0] + np.pi / 2) % np.pi - np.pi / 2
            assert got[i] == pytest.approx(step / 2e-6, rel=1e-5, abs=1e-7)
