"""What is predicted of a loop, against closed forms of a filter of two states, and a late drive against SciPy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.identify.prediction import Holding, Loop, minus_3_dB, rate_needed_Hz
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant

_HERTZ, _RATE, _NOISE = 1000.0, 20_000.0, 1e-3  # noise over amplitude
_OMEGA = 2.0 * math.pi * _HERTZ
_DEVICE = Device(
    sample_rate=_RATE, stiffness=(_OMEGA**2, _OMEGA**2, 0.0), damping=(5.0, 5.0, 0.0), amplitude=1e-5,
    sense_gain=(1e4, 1e4), noise=(0.1 * _NOISE, 0.1 * _NOISE),
)  # fmt: skip
_LAW = ControllerSettings(
    latency=2, force_quantum=1e-6, force_limit=100.0, sense_quantum=1e-6, energy_gain=0.02, quadrature_gain=0.02
)
_WALK = 0.5  # rad/s per √s
_KNOWN = ObserverSettings(
    variant=Variant.SENSE, gain=Gain.EKF, memory=0.2, process_noise=ProcessNoise(rate=_WALK),
    spread=Spread(offset=1e-6, rate=1.0, stiffness=1e-9, damping=1e-9),
)  # fmt: skip


def loop(settings: ObserverSettings = _KNOWN, **device: object) -> Loop:
    return Loop(replace(_DEVICE, **device), settings, _LAW)  # type: ignore[arg-type]


def test_noise_and_bandwidths_are_a_kalman_filter_s() -> None:
    """An angle seen with density R, whose rate walks by q: ωn = (q²/R)^¼, poles of Butterworth, zero at −ωn/√2."""
    density = 2.0 * _NOISE**2 / _RATE
    natural = (_WALK**2 / density) ** 0.25
    found = loop().prediction(None)
    assert found.rate_bandwidth_Hz == pytest.approx(natural / (2.0 * math.pi), rel=0.04)
    assert found.angle_bandwidth_Hz == pytest.approx(
        math.sqrt(2.0 + math.sqrt(5.0)) * natural / (2.0 * math.pi), rel=0.04
    )
    # The gains √2 ωn and ωn² let through (a² + b) / 2a of the density.
    assert found.angle_noise_rad == pytest.approx(math.sqrt(3.0 / (2.0 * math.sqrt(2.0)) * density * natural), rel=0.04)
    assert found.delay_margin_s is None


def test_a_random_force_makes_the_angle_wander() -> None:
    """F/(2 ω A) of a force of density F across the vibration, whatever the filter is."""
    force = 2e-2
    noisy = replace(_KNOWN, process_noise=ProcessNoise(rate=_WALK, force=force))
    found = loop(noisy).prediction(None)
    assert found.angle_random_walk_rad_per_rts == pytest.approx(force / (2.0 * _OMEGA * _DEVICE.amplitude), rel=0.04)


@pytest.mark.parametrize(("split", "virtual"), [(0.0, 12.0), (40.0, 12.0), (40.0, 24.0)])
def test_sense_noise_makes_the_angle_of_a_split_device_wander(split: float, virtual: float) -> None:
    """By √(Ωv² + (Δω/2)²) times the density of its share of the amplitude, docs/explanation.md."""
    springs = (_OMEGA**2 + split * _OMEGA, _OMEGA**2 - split * _OMEGA, 0.0)
    settings = ObserverSettings(memory=0.4, process_noise=ProcessNoise(rate=5.0))
    turned = Loop(replace(_DEVICE, stiffness=springs), settings, replace(_LAW, virtual_rotation=virtual))
    walk = _NOISE * math.sqrt(2.0 / _RATE) * math.hypot(virtual, 0.5 * split)
    found = turned._noise(*turned._played(np.zeros(turned._settled + turned._span)))[1]
    assert found == pytest.approx(walk, rel=0.08)


@pytest.mark.parametrize("late", [0.0, 0.4, 1.0, 2.7])
def test_a_late_drive_is_exactly_late(late: float) -> None:
    sense, drive = loop()._played(np.zeros(400), late)
    whole, part = int(late), late - int(late)
    motion = np.zeros((6, 6))
    motion[0, 1] = motion[2, 3] = motion[1, 4] = motion[3, 5] = 1.0
    motion[1, :2] = motion[3, 2:4] = -(_OMEGA**2), -5.0
    acted = np.concatenate([np.zeros((4, 2)), drive[:, :, 0]])
    state, seen = np.array([_DEVICE.amplitude, 0.0, 0.0, 0.0]), []
    for m in range(400):
        for back, share in ((whole + 1, part), (whole, 1.0 - part)):
            state = (expm(motion * share / _RATE) @ np.concatenate([state, acted[m + 4 - back]]))[:4]
        seen.append(1e4 * state[[0, 2]])
    assert np.abs(drive).max() > 1e-3
    np.testing.assert_allclose(sense, seen, rtol=0.0, atol=1e-8)


def test_the_margin_is_where_the_limits_are_passed() -> None:
    """Springs that differ by 1 %: the later the drive that makes them alike, the more quadrature."""
    uneven = loop(stiffness=(1.01 * _OMEGA**2, 0.99 * _OMEGA**2, 0.0))
    holding = Holding(energy_error=0.05, quadrature=0.05, invalid=0.05)
    found = uneven.prediction(holding)
    assert found.delay_margin_s is not None
    assert not found.margin_open
    samples = found.delay_margin_s * _RATE
    assert uneven.beyond(0.9 * samples, holding) < 1.0 < uneven.beyond(1.1 * samples, holding)
    needed = rate_needed_Hz(_OMEGA, found)
    assert needed["a tick within the delay margin"] == pytest.approx(1.0 / found.delay_margin_s)


def test_a_first_order_step_has_its_corner() -> None:
    step_s, corner = 1e-4, 50.0
    step = 1.0 - np.exp(-2.0 * math.pi * corner * step_s * np.arange(2000))
    assert minus_3_dB(step, step_s) == pytest.approx(corner, rel=0.02)
    assert minus_3_dB(np.ones(50), step_s) == math.inf
