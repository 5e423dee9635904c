"""Gain mode of the C board: the drive it echoes is the law of docs/wire.md, evaluated here from its own record."""

import ctypes

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.wire.messages import (
    Arm,
    ClockMode,
    DriveGains,
    Hello,
    LoopMode,
    Message,
    RegisterWrite,
    SenseFlags,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter

from .c_board import CBoard

pytestmark = pytest.mark.slow

FILTER = {"A11": 0.9, "A12": 0.25, "A21": -0.3, "A22": 0.7, "B1": 0.2, "B2": -0.1, "C1": 0.05, "C2": 0.4}
BLOCK = 20
SEED, DITHER, LIMIT = 12345, 40, 1500
GAIN = (0.5, -0.25, 0.1, 0.05, -0.2, 0.3, 0.6, -0.4)


class Host:
    """Says messages to a board in this process."""

    def __init__(self, library: ctypes.CDLL, latency: int, **registers: float) -> None:
        self.board = CBoard(library, latency=latency)
        self.tx, self.rx = Transmitter(), Receiver()
        self.say(Hello(SPEC.protocol, SPEC.hash))
        settings = {"CLOCK_MODE": ClockMode.LOCKSTEP, "LOOP_MODE": LoopMode.GAIN, "BLOCK": BLOCK}
        for name, value in (settings | registers).items():
            (answer,) = self.say(RegisterWrite(SPEC.registers[name].id, value))
            assert answer[:] == (SPEC.registers[name].id, value)

    def say(self, message: Message) -> list[Message]:
        return [received.message for received in self.rx.feed(self.board.exchange(self.tx.encode(message, 0)))]


def signs(seed: int, ticks: int) -> NDArray[np.float64]:
    """Signs of the dither, shape (ticks, 2)."""
    register, out = seed, []
    for _ in range(2 * ticks):
        bit = register & 1
        register = register >> 1 ^ 0xA3000000 * bit
        out.append(2.0 * bit - 1.0)
    return np.reshape(out, (ticks, 2))


def law(codes: NDArray[np.int32], delay: int, matrices: list[tuple[int, tuple[float, ...]]]) -> NDArray[np.float64]:
    """u computed from each row, shape (n, 2), not yet rounded; `matrices` are (first tick, gain)."""
    a = np.array([[FILTER["A11"], FILTER["A12"]], [FILTER["A21"], FILTER["A22"]]])
    b, c = np.array([FILTER["B1"], FILTER["B2"]]), np.array([FILTER["C1"], FILTER["C2"]])
    v = codes[:, :2].astype(float)
    s = np.zeros((2, 2))  # axis, component
    u = np.zeros((len(v), 2))
    dither = signs(SEED, len(v))
    for m in range(len(v)):
        then = v[m - delay] if m >= delay else np.zeros(2)
        s = s @ a.T + np.outer(v[m], b) + np.outer(then, c)
        gain = next((np.reshape(g, (2, 4)) for first, g in reversed(matrices) if first <= m), None)
        if gain is not None:
            u[m] = gain @ s.ravel() + (3.25, -7.5) + DITHER * dither[m]
    return u


@pytest.mark.parametrize(("latency", "delay"), [(0, 1), (1, 5), (2, 63), (15, 1)])
def test_the_echo_is_the_law(library: ctypes.CDLL, latency: int, delay: int) -> None:
    filters = {f"FILTER_{name}": value for name, value in FILTER.items()}
    host = Host(
        library, latency, **filters, FILTER_DELAY=delay, DITHER_SEED=SEED, DITHER_AMPLITUDE=DITHER, DRIVE_LIMIT=LIMIT
    )
    heard = host.say(Arm())
    other = tuple(-g for g in GAIN)
    switches = [(30, GAIN), (71, other), (95, GAIN)]
    for k, (first, gain) in enumerate(switches):
        heard += host.say(DriveGains(k + 1, gain, (3.25, -7.5), first))
        if k == 0:
            heard += host.say(DriveGains(1, gain, (3.25, -7.5), first))
    heard += host.say(DriveGains(9, GAIN, (3.25, -7.5), 10**4))
    blocks = [message for message in heard if isinstance(message, Sense)]
    codes = np.concatenate([sense.codes for sense in blocks])
    assert len(codes) == 6 * BLOCK
    exact = law(codes, delay, switches)
    expected = np.clip(np.rint(exact), -LIMIT, LIMIT)
    echoed = codes[1 + latency :, 2:]  # computed at m, held over the interval that ends at m + latency + 1
    assert np.all(codes[: 1 + latency, 2:] == 0)
    assert np.abs(echoed - expected[: len(echoed)]).max() <= 1.0  # single precision may round the other way
    assert np.mean(echoed != expected[: len(echoed)]) < 0.05
    assert (np.abs(exact) > LIMIT).any()
    assert (np.abs(expected) < LIMIT).any()
    ends = [BLOCK * (k + 1) - 1 for k in range(6)]
    named = [sum(first <= end for first, _ in switches) for end in ends]
    assert [sense.matrix_id for sense in blocks] == named
    limited = [bool((np.abs(exact[end - BLOCK + 1 : end + 1]) > LIMIT + 0.5).any()) for end in ends]
    assert [bool(sense.flags & SenseFlags.SATURATED) for sense in blocks] == limited


def test_dither_takes_its_time_to_repeat(library: ctypes.CDLL) -> None:
    host = Host(library, 0, DITHER_SEED=SEED, DITHER_AMPLITUDE=1)
    host.say(Arm())
    heard = [host.say(DriveGains(1, (0.0,) * 8, (0.0, 0.0), 20))[-1] for _ in range(1000)]
    signs = np.concatenate([m.codes[:, 2:] for m in heard if isinstance(m, Sense)])[1:].ravel()
    assert set(signs) == {-1, 1}
    assert abs(signs.mean()) < 4.0 / np.sqrt(len(signs))
    spectrum = np.abs(np.fft.rfft(signs)[1:]) ** 2 / len(signs)
    assert spectrum.max() < 20.0  # of white noise, the largest of 2e4 is about ten


@pytest.mark.parametrize("register", ["FILTER_A11", "FILTER_C2"])
def test_real_registers_take_any_number_within_their_limits(library: ctypes.CDLL, register: str) -> None:
    host = Host(library, 1)
    identifier = SPEC.registers[register].id
    for value in (0.1, -15.9, 1e-30, 16.0):
        (answer,) = host.say(RegisterWrite(identifier, value))
        assert answer[:] == (identifier, value)
    for value in (16.1, -1e9, float("nan"), float("inf")):
        (answer,) = host.say(RegisterWrite(identifier, value))
        assert answer[-1] == 6
