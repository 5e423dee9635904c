"""The constants of an oscillator by maximum likelihood, on records of a simulation of this file's own: SciPy's
discretisation in eighths of a sample, Euler steps of nothing.
"""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete

from estimator.identify.derived import constants_of, derived
from estimator.identify.fit import Fitted, grown
from estimator.identify.model import NAMES, pieces
from estimator.identify.start import start

Array = NDArray[np.float64]
_PARTS = 8
_ROWS = 12_000


class Simulated(NamedTuple):
    sense: Array
    drive: Array
    truth: Array
    thermal: float


def simulated(seed: int, *, force: float = 0.0) -> Simulated:
    """A device drawn at random; force: density of a force noise, (m/s²)²/Hz, two-sided."""
    rng = np.random.default_rng(seed)
    rate, split, azimuth = 200.0 * rng.uniform(15.0, 30.0), rng.uniform(0.0, 4.0), rng.uniform(0.0, 3.0)
    omegas = 2.0 * np.pi * (200.0 + 0.5 * split * np.array([1.0, -1.0]))
    turn = np.array([[np.cos(azimuth), -np.sin(azimuth)], [np.sin(azimuth), np.cos(azimuth)]])
    stiffness = turn @ np.diag(omegas**2) @ turn.T
    damping = turn.T @ np.diag(2.0 / rng.uniform(0.3, 3.0) * np.array([1.0, 1.2])) @ turn
    spin, share = rng.normal(0.0, 0.1), rng.normal(0.0, 0.003, 2)
    a = np.block([
        [np.zeros((2, 2)), np.eye(2)],
        [-stiffness, -(damping + 2.0 * spin * np.array([[0.0, -1.0], [1.0, 0.0]]))],
    ])  # fmt: skip
    b = np.vstack([np.zeros((2, 2)), [[1.0, share[0]], [share[1], 1.0]]])
    step, push, *_ = cont2discrete((a, b, np.eye(4), np.zeros((4, 2))), 1.0 / rate / _PARTS)
    late = int(rng.integers(0, 24))
    drive, part = np.zeros((_ROWS, 2)), _ROWS // 8
    for axis, begin in ((0, part // 4), (1, 2 * part)):
        drive[begin : begin + part // 2, axis] = np.sign(rng.standard_normal(part // 2))
    wave = 2.0 * np.pi * 200.0 / rate * np.arange(part // 2)
    drive[4 * part : 4 * part + part // 2] = np.column_stack([np.cos(wave), np.sin(wave)])
    held = np.vstack([np.zeros((late, 2)), np.repeat(drive, _PARTS, axis=0)])[: _PARTS * _ROWS]
    pushed = (held + np.sqrt(force * rate * _PARTS) * rng.standard_normal(held.shape)) @ push.T
    motion, sense = np.zeros(4), np.zeros((_ROWS, 2))
    gains, offset = -900.0 * rng.uniform(0.9, 1.1, 2), rng.uniform(-0.01, 0.01, 2)
    for row in range(1, _ROWS):
        for k in range(_PARTS * row, _PARTS * row + _PARTS):
            motion = step @ motion + pushed[k]
        sense[row] = gains * motion[:2]
    sense += offset + 10.0 ** rng.uniform(-5.0, -3.5) * rng.standard_normal(sense.shape)
    k, d, ts = stiffness / rate**2, damping / rate, 1.0 / rate
    truth = np.array([
        k[0, 0], k[1, 1], k[0, 1], d[0, 0], d[1, 1], d[0, 1], spin * ts, *(gains * ts**2), *share,
        late / _PARTS, *offset,
    ])  # fmt: skip
    return Simulated(sense, drive, truth, force * rate / float(np.mean(np.diag(d))))


def fitted(record: Simulated) -> Fitted:
    parts = list(pieces(record.sense, record.drive))
    return grown(parts, start(parts).theta, record.thermal)


@pytest.mark.parametrize(("first", "force"), [(0, 0.0), (100, 1e-10)])
def test_intervals_hold_what_they_say(first: int, force: float) -> None:
    """6 devices of 14 constants: of 84 numbers 95 % are within 1.96 deviations, and their squares average 1; as some
    constants of a device are correlated, these count as some 40 draws.
    """
    z = []
    for seed in range(first, first + 6):
        record = simulated(seed, force=force)
        found = fitted(record)
        assert found.converged
        z.append((found.theta - record.truth) / np.sqrt(np.diag(found.covariance)))
    inside, square = float(np.mean(np.abs(z) < 1.96)), float(np.mean(np.square(z)))
    assert inside > 0.85
    assert 0.4 < square < 1.7


def test_a_gap_costs_samples_and_no_bias() -> None:
    record = simulated(3)
    sense = record.sense.copy()
    sense[5000:5300] = np.nan
    found = fitted(record._replace(sense=sense))
    z = (found.theta - record.truth) / np.sqrt(np.diag(found.covariance))
    assert np.max(np.abs(z)) < 4.0


def test_resonances_and_axes_follow_from_it() -> None:
    """Against NumPy's eigenvalues of the true matrices."""
    record = simulated(5)
    found, rate = fitted(record), 4000.0
    told = constants_of(found, rate)
    truth = dict(zip(NAMES, record.truth, strict=True))
    values, shapes = np.linalg.eigh(np.array([[truth["kxx"], truth["kxy"]], [truth["kxy"], truth["kyy"]]]))
    azimuth = np.arctan2(shapes[1, 1], shapes[0, 1]) % np.pi
    for name, true in (
        ("resonance_1", np.sqrt(values[1]) * rate / (2.0 * np.pi)),
        ("resonance_2", np.sqrt(values[0]) * rate / (2.0 * np.pi)),
        ("azimuth", azimuth),
    ):
        assert abs(told[name].value - true) < 4.0 * told[name].u
        assert told[name].u > 0.0


def test_a_q_is_that_of_its_resonance_even_where_the_other_decays_quicker() -> None:
    """Against the eigenvalues of the motion, whose split is far wider than its damping."""
    turn = np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]])
    k = turn @ np.diag((2.0 * np.pi * np.array([502.0, 498.0])) ** 2) @ turn.T
    d = turn @ np.diag(2.0 * np.pi * np.array([502.0, 498.0]) / [1000.0, 800.0]) @ turn.T
    roots = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-k, -d]]))
    roots = roots[np.argsort(-roots.imag)][:2]
    expected = np.abs(roots) / (-2.0 * roots.real)
    value = np.array([k[0, 0], k[1, 1], k[0, 1], d[0, 0], d[1, 1], d[0, 1], 0.0, 1.0, 1.0])
    assert derived(value)[6:8] == pytest.approx(expected, rel=1e-5)
    assert expected == pytest.approx([1000.0, 800.0], rel=1e-5)
