"""A constant that takes up an effect: what is declared of it tells (docs/reference/trace.md).

The records are those of a rate gyro whose x is held and whose y is damped by its drive, in closed form: between two
samples the drive is held, and the motion is that of a linear system.
"""

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.settings import Device, ObserverSettings, ProcessNoise, Spread
from estimator.trace.conflict import runs_backwards
from estimator.trace.diagnosis import Verdict
from estimator.trace.problem import Problem
from estimator.trace.promises import Constant
from estimator.trace.record import Record
from estimator.trace.tracing import trace

RATE, N = 4000.0, 24_000
DEVICE = Device(
    sample_rate=RATE,
    stiffness=(1.6e6, 1.62e6, -1.2e4),
    damping=(0.8, 0.8, 0.0),
    amplitude=1e-5,
    sense_gain=(3e4, 3e4),
    noise=(2.5e-4, 2.5e-4),
)
SETTINGS = ObserverSettings(
    memory=1.0, spread=Spread(rate=0.2, stiffness=0.005, damping=1.0), process_noise=ProcessNoise(rate=2e-4)
)
DAMPED = 40.0
"""Times its own damping, that of y by its drive."""


def record(gain_y: float) -> Record:
    """`gain_y`: of the drive of y, relative to the declared one."""
    kxx, kyy, kxy = DEVICE.stiffness
    d = DEVICE.damping[0]
    free = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.array([[kxx, kxy], [kxy, kyy]]), -d * np.eye(2)]])
    driven = np.zeros((6, 6))
    driven[:4, :4] = free
    driven[2:4, 4:] = np.diag([1.0, gain_y])
    step = expm(driven / RATE)
    random = np.random.default_rng(3)
    state = np.array([DEVICE.amplitude, 0.0, 0.0, 0.0])
    motion, drive = np.zeros((N, 2)), np.zeros((N, 2))
    for tick in range(N):
        motion[tick] = state[:2]
        drive[tick] = d * state[2], -DAMPED * d * state[3]
        state = step[:4] @ np.concatenate([state, drive[tick]])
    sense = motion * DEVICE.sense_gain + random.standard_normal((N, 2)) * DEVICE.noise
    # row n holds what was sensed at its end, and the drive of the interval before
    return Record(sense[1:], drive[:-1, :, None], np.full(N - 1, 1.0 / RATE))


@pytest.mark.slow
@pytest.mark.timeout(900)  # a whole trace
def test_a_damping_below_zero_is_a_drive_that_is_weaker_than_declared() -> None:
    said = trace(Problem(record(0.85), DEVICE, SETTINGS), split=round(0.6 * N))
    assert said.verdict is Verdict.PARTLY
    assert [effect.name for effect in said.effects] == ["drive_gain"]
    hy = said.effects[0].coefficients["hy"]
    assert hy.low < -0.15 < hy.high
    assert hy.high - hy.low < 0.1
    assert any(reason.startswith("dyy comes out negative") for reason in said.reasons)


@pytest.mark.slow
@pytest.mark.timeout(900)  # a whole trace
def test_a_drive_that_is_as_declared_leaves_the_damping_what_it_is() -> None:
    assert trace(Problem(record(1.0), DEVICE, SETTINGS), split=round(0.6 * N)).verdict is Verdict.ADEQUATE


def damping(name: str, value: float, declared: float = 200.0) -> Constant:
    return Constant(name, value, value - 2.0, value + 2.0, declared, 60.0, positive=True)


@pytest.mark.parametrize(
    ("dxx", "dyy", "said"),
    [(-281.0, -270.0, True), (-281.0, 270.0, False), (281.0, 270.0, False), (-281.0, -900.0, False)],
)
def test_a_record_in_reverse_order_has_the_damping_of_both_axes_with_the_other_sign(
    dxx: float, dyy: float, *, said: bool
) -> None:
    told = runs_backwards((damping("dxx", dxx), damping("dyy", dyy), damping("kxx", 1.0)))
    assert (told is not None) is said
