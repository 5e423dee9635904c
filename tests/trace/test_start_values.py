"""What is looked for on a record: modes from the drive's response, labels that stay apart, second thoughts."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.effects.labels import searched_by
from estimator.effects.search import Search
from estimator.trace.start_values import resonance
from tests.estimator.test_scan import DEVICE

ONE_AXIS = replace(
    DEVICE, stiffness=DEVICE.stiffness[:1], damping=DEVICE.damping[:1], sense_gain=(-890.0,), noise=(9e-5,)
)


def mode(omega: float, zeta: float, at: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 / (omega**2 - at**2 + 2j * zeta * omega * at))


@pytest.mark.parametrize(("omega", "zeta"), [(1000.0, 2e-2), (1030.0, 1e-3), (960.0, 8e-3)])
def test_the_response_to_the_drive_tells_a_mode(omega: float, zeta: float) -> None:
    at = np.arange(900.0, 1101.0, 12.5)
    responses = [size * mode(omega, zeta, at) for size in (3.0, -0.7)]
    noise = np.random.default_rng(1).standard_normal((2, 2, len(at))) * 2e-3 * np.max(np.abs(responses))
    seen = resonance(at, [r + n[0] + 1j * n[1] for r, n in zip(responses, noise, strict=True)])
    assert seen is not None
    assert seen[0] == pytest.approx(omega, rel=2e-3)
    assert seen[1] == pytest.approx(zeta, rel=0.2, abs=5e-4)


def test_a_flat_response_tells_none() -> None:
    at = np.arange(900.0, 1101.0, 12.5)
    random = np.random.default_rng(2)
    assert resonance(at, [1.0 + 0.01 * random.standard_normal(len(at)) + 0j]) is None


def test_every_searched_parameter_of_the_catalogue_says_its_range() -> None:
    assert searched_by("dry_friction") is searched_by("dry_friction:2") is Search.SPEEDS
    assert searched_by("cubic_stiffness") is None
    assert searched_by("an_effect_of_my_own") is None
