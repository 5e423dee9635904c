"""The matrix of gain mode beside a loop written out here: the continuous gyro under a held drive (matrix exponential),
the board's filter, its delay, and the matrix.  What the matrix promises are the frequencies and damping of that loop.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from estimator.errors import ModelError
from estimator.gain_matrix import BoardFilter, GainMatrix, luenberger, pair
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, ObserverSettings

Floats = NDArray[np.float64]

OMEGA0 = 2.0 * np.pi * 5e3
GAIN_V_PER_M = (-8.8e4, -8.2e4)
SENSE_V = 2.0**-17
QUANTUM = 200.0 / 2**15
OFFSET_V = (0.01, -0.02)
RATE = 1e-3 * OMEGA0
VIRTUAL = 5e-3 * OMEGA0
QUICK = 24e-3 * OMEGA0  # of virtual rotation: half a turn in 400 samples


@dataclass(frozen=True)
class Case:
    """A gyro sampled `samples` times a cycle, `split` of its stiffness between the axes, and a board's latency."""

    samples: float = 20.0
    split: float = 0.04
    latency: int = 1
    rate: float = RATE
    controller: tuple[tuple[str, float], ...] = ()

    @property
    def step(self) -> float:
        return 2.0 * np.pi / (OMEGA0 * self.samples)

    @property
    def stiffness(self) -> tuple[float, float, float]:
        k = OMEGA0**2
        return k * (1.0 + self.split / 2), k * (1.0 - self.split / 2), 0.01 * k

    @property
    def damping(self) -> tuple[float, float, float]:
        return OMEGA0 / 1000.0, 1.2 * OMEGA0 / 1000.0, 0.1 * OMEGA0 / 1000.0

    def observer(self, **controller: float) -> Observer:
        """An observer that knows the gyro."""
        device = Device(
            sample_rate=1.0 / self.step,
            stiffness=self.stiffness,
            damping=self.damping,
            amplitude=2e-6,
            sense_gain=GAIN_V_PER_M,
            noise=(5e-5, 5e-5),
            target_stiffness=OMEGA0**2,
        )
        settings: dict[str, Any] = {"energy_gain": 0.0, "quadrature_gain": 0.0, "virtual_rotation": VIRTUAL}
        known = {"rate": self.rate, "phi_x": OFFSET_V[0], "phi_y": OFFSET_V[1], "x": 2e-6}
        return Observer(
            device,
            ObserverSettings(initial=known),
            ControllerSettings(self.latency, QUANTUM, 200.0, SENSE_V, **(settings | controller)),
        )

    def plant(self) -> tuple[Floats, Floats]:
        """Ẋ = A X + B u in SI, X = (x, ẋ, y, ẏ)."""
        (kxx, kyy, kxy), (dxx, dyy, dxy), w = self.stiffness, self.damping, self.rate
        a = [
            [0, 1, 0, 0],
            [w * w - kxx, -dxx, -kxy, 2 * w - dxy],
            [0, 0, 0, 1],
            [-kxy, -dxy - 2 * w, w * w - kyy, -dyy],
        ]
        return np.array(a), np.array([[0.0, 0], [1, 0], [0, 0], [0, 1]])

    def held(self) -> tuple[Floats, Floats]:
        """Exact over one sample, the drive held."""
        a, b = self.plant()
        both = np.zeros((6, 6))
        both[:4, :4], both[:4, 4:] = a, b
        whole = expm(both * self.step)
        return whole[:4, :4], whole[:4, 4:]


class Board:
    """The law of docs/wire.md, without rounding and limits."""

    def __init__(self, board: BoardFilter, gain: Floats, bias: Floats, latency: int) -> None:
        self.a, self.b, self.c = (np.array(part) for part in (board.a, board.b, board.c))
        self.gain, self.bias = gain.copy(), bias.copy()
        self.past = [np.zeros(2)] * board.delay
        self.s = np.zeros((2, 2))
        self.queue = [np.zeros(2)] * latency

    def drive(self, codes: Floats) -> Floats:
        """Drive codes over the interval that begins now, for the sense codes of now."""
        self.s = self.s @ self.a.T + np.outer(codes, self.b) + np.outer(self.past[-1], self.c)
        self.past = [codes, *self.past[:-1]]
        self.queue.append(self.gain @ self.s.ravel() + self.bias)
        return self.queue.pop(0)


def codes_of(motion: Floats) -> Floats:
    """Sense codes of (x, ẋ, y, ẏ), not rounded."""
    return (np.array(GAIN_V_PER_M) * motion[[0, 2]] + OFFSET_V) / SENSE_V


def loop_matrix(case: Case, board: BoardFilter, gain: Floats) -> Floats:
    """The whole loop as one matrix, found by what it does to each unit of its state; the offsets leave no trace."""
    ad, bd = case.held()

    def step(state: Floats) -> Floats:
        one = Board(board, gain, np.zeros(2), case.latency)
        motion, one.s = state[:4], state[4:8].reshape(2, 2)
        rest = state[8:].reshape(-1, 2)
        one.past, one.queue = list(rest[: board.delay]), list(rest[board.delay :])
        drive = one.drive(np.array(GAIN_V_PER_M) * motion[[0, 2]] / SENSE_V) * QUANTUM
        return np.concatenate([ad @ motion + bd @ drive, one.s.ravel(), *one.past, *one.queue])

    size = 8 + 2 * board.delay + 2 * case.latency
    return np.column_stack([step(unit) for unit in np.eye(size)])


def target(case: Case, hold: float = 0.0, square: float = 0.0) -> Floats:
    """Ẋ = M X of what is aimed at: isotropic, undamped but for the holds, turning at Ω + Ωv."""
    w, k = case.rate + VIRTUAL, OMEGA0**2 - case.rate**2
    return np.array(
        [
            [0, 1, 0, 0],
            [-k, hold, -square - hold * w, 2 * w],
            [0, 0, 0, 1],
            [square + hold * w, -2 * w, -k, hold],
        ]
    )


CASES = [
    *(Case(latency=latency) for latency in (0, 1, 2, 3)),
    *(Case(samples=samples) for samples in (8.0, 50.0, 100.0)),
    Case(split=0.4, latency=2),
    Case(rate=-VIRTUAL),  # two modes at one frequency
]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=str)
@pytest.mark.parametrize("kind", ["luenberger", "pair", "late pair"])
def test_the_loop_has_the_frequencies_that_were_asked_for(case: Case, kind: str) -> None:
    """Four eigenvalues exp(± i (ωe ± W) T) on the unit circle to rounding; all others well inside."""
    observer = case.observer()
    board = {
        "luenberger": luenberger(observer.h),
        "pair": pair(1),
        "late pair": pair(max(round(case.samples / 4), 1)),
    }[kind]
    gain, _ = GainMatrix(observer, board).solve(500)
    found = np.linalg.eigvals(loop_matrix(case, board, gain))
    found = found[np.argsort(-np.abs(found))]
    wanted = np.exp(np.linalg.eigvals(target(case)) * case.step)
    twice = 1e-6 if case.rate == -VIRTUAL else 1e-9  # a double eigenvalue moves by the root of a disturbance
    for value in wanted:
        assert np.min(np.abs(found[:4] - value)) < twice
    assert np.max(np.abs(found[4:])) < 0.8


def test_the_poles_of_the_default_filter() -> None:
    poles = np.linalg.eigvals(np.array(luenberger(0.3).a))
    np.testing.assert_allclose(sorted(poles, key=np.imag), 0.7 * np.exp([-0.3j, 0.3j]), rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("case", [Case(latency=0), Case(), Case(latency=2), Case(split=0.4)], ids=str)
def test_the_pattern_turns_as_it_should_in_a_continuous_gyro(case: Case) -> None:
    """Integrated in continuous time under the held drive, offsets and all: θ̇ = −(Ω + Ωv), no decay, no ellipse.

    Between samples the held force is not the continuous one; what that leaves in the velocities, and so in the angle,
    is back where it was after each half turn of the pattern.
    """
    observer = case.observer(virtual_rotation=QUICK)
    board = luenberger(observer.h)
    loop = Board(board, *GainMatrix(observer, board).solve(500), case.latency)
    a, b = case.plant()
    w, k = case.rate + QUICK, OMEGA0**2 - case.rate**2
    half_turn = round(np.pi / (w * case.step))
    motion, angles, energies, momenta = np.array([2e-6, 0.0, 0.0, 0.0]), [], [], []
    for m in range(100 + 2 * half_turn):
        drive = b @ loop.drive(codes_of(motion)) * QUANTUM
        if m >= 100:  # the loop began with an empty filter
            x, vx, y, vy = motion[0], motion[1] - w * motion[2], motion[2], motion[3] + w * motion[0]
            kw = k + w * w
            angles.append(0.5 * np.arctan2(2 * (kw * x * y + vx * vy), kw * (x * x - y * y) + vx * vx - vy * vy))
            energies.append(0.5 * (kw * (x * x + y * y) + vx * vx + vy * vy))
            momenta.append(OMEGA0 * (x * vy - y * vx) / energies[-1])
        motion = solve_ivp(
            lambda _, s, held: a @ s + held, (0.0, case.step), motion, "DOP853", rtol=1e-12, atol=1e-18, args=(drive,)
        ).y[:, -1]
    theta = np.unwrap(2.0 * np.array(angles)) / 2.0
    turned = (theta[half_turn:] - theta[:half_turn]) / (half_turn * case.step)
    assert np.mean(turned) / -w == pytest.approx(1.0, abs=1e-7)
    assert energies[-1] == pytest.approx(energies[0], rel=1e-4)
    assert np.ptp(momenta) < 5e-3


@pytest.mark.moderate
def test_holds_are_in_it_and_no_faster_than_the_host() -> None:
    """A sluggish energy, a round pattern: their damping as eigenvalues of the loop; and capped by the time between."""
    case = Case()
    for gain, horizon, fastest in ((1e-3, 10, np.inf), (0.5, 500, 0.25 / 500)):
        observer = case.observer(energy_gain=gain, quadrature_gain=gain)
        observer.x[:4] = 0.9, 0.0, 0.0, 0.2
        w = (case.rate + VIRTUAL) / OMEGA0
        x, vx, vy = 0.9, 0.0, 0.2 + w * 0.9
        ke = 1.0 + w * w - (case.rate / OMEGA0) ** 2
        energy = 0.5 * (ke * x * x + vx * vx + vy * vy)
        rate = min(gain, fastest / observer.h)
        hold = rate * (0.5 - energy) / 0.5 * OMEGA0
        square = -rate * x * vy / energy * OMEGA0**2
        board = luenberger(observer.h)
        matrix, _ = GainMatrix(observer, board).solve(horizon)
        found = np.linalg.eigvals(loop_matrix(case, board, matrix))
        for value in np.exp(np.linalg.eigvals(target(case, hold, square)) * case.step):
            assert np.min(np.abs(found - value)) < 1e-9


def test_offsets_cause_no_force() -> None:
    """The mass at rest: what the board sees is offset alone, and G s + b is nothing."""
    observer = Case().observer()
    for board in (luenberger(observer.h), pair(5)):
        loop = Board(board, *GainMatrix(observer, board).solve(500), 1)
        for _ in range(200):
            drive = loop.drive(codes_of(np.zeros(4)))
        np.testing.assert_allclose(drive, 0.0, atol=1e-6)


def test_an_estimate_that_is_lost_makes_no_matrix() -> None:
    observer = Case().observer()
    solver = GainMatrix(observer, luenberger(observer.h))
    assert np.abs(solver.solve(500)[0]).max() > 0.1
    observer.x[7] = np.nan
    gain, bias = solver.solve(500)
    assert not gain.any()
    assert not bias.any()


def test_a_pair_half_a_cycle_apart_is_one_signal() -> None:
    observer = Case().observer()
    with pytest.raises(ModelError, match=r"over 10 samples \(1 half cycles\) gives one signal twice"):
        GainMatrix(observer, pair(10))


def test_the_matrix_takes_the_gyro_from_the_estimate() -> None:
    """Two stiffnesses 1 % off, one up, one down: a split of ± ½ % beside that of the rotation."""
    case = Case()
    observer = replace(case, split=0.06).observer()
    board = luenberger(observer.h)
    gain, _ = GainMatrix(observer, board).solve(500)
    found = np.linalg.eigvals(loop_matrix(case, board, gain))
    shift = np.abs(np.angle(found[np.abs(found) > 0.9])) / (OMEGA0 * case.step) - 1.0
    assert np.max(np.abs(shift)) == pytest.approx(np.hypot(0.005, 0.006), rel=0.01)
