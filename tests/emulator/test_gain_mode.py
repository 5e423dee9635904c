"""Gain mode on the board beside the law of docs/wire.md, written out once more: the echo is what the law gives."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from device_emulator.device import Device
from device_emulator.scenario import Scenario
from hil.wire.messages import (
    Arm,
    ClockMode,
    DriveGains,
    Hello,
    LoopMode,
    Message,
    NackReason,
    Safe,
    SafeReason,
    SenseFlags,
    State,
    Status,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from tests.emulator.gyro import scenario
from tests.emulator.test_board import Host, codes, flags, nack

BLOCK = 20
A = ((0.6, -0.3), (0.2, 0.5))
B = (0.5, -0.25)
C = (0.125, 1.0)
DELAY = 3
GAINS = {
    1: ((0.3, -0.2, 0.1, 0.05, -0.1, 0.2, 0.4, -0.3), (12.5, -7.0)),
    2: ((-0.25, 0.5, 0.0, 0.125, 0.75, 0.0, -0.5, 0.25), (-3.0, 400.0)),
    3: ((30.0, 20.0, -10.0, 5.0, 5.0, 10.0, 20.0, -30.0), (0.0, 0.0)),
}


def gains(matrix_id: int, effective_tick: int) -> DriveGains:
    return DriveGains(matrix_id, *GAINS[matrix_id], effective_tick)


def ready(what: Scenario, *clocks: ClockMode, **registers: float) -> Host:
    """A host whose board is set to gain mode, not armed."""
    host = Host(what, clocks or (ClockMode.LOCKSTEP,))
    host.say(Hello(SPEC.protocol, SPEC.hash))
    for name, value in {"LOOP_MODE": LoopMode.GAIN, "BLOCK": BLOCK, **registers}.items():
        host.set(name, value)
    return host


def with_filter(**more: float) -> dict[str, float]:
    table = {f"FILTER_A{i + 1}{j + 1}": A[i][j] for i in range(2) for j in range(2)}
    table |= {f"FILTER_B{i + 1}": B[i] for i in range(2)} | {f"FILTER_C{i + 1}": C[i] for i in range(2)}
    return table | {"FILTER_DELAY": DELAY} | more


def expected(
    voltages: NDArray[np.int64], schedule: dict[int, int], latency: int, limit: int, seed: int, amplitude: int
) -> NDArray[np.int64]:
    """The law for codes (n, 2) sampled from tick 0 on; `schedule`: first tick of each matrix.  Drive of each row."""
    n = len(voltages)
    seen = np.vstack([np.zeros((DELAY, 2)), voltages])
    s = np.zeros((2, 2))  # component, axis
    echo = np.zeros((n + latency + 1, 2), np.int64)
    register, current = seed, 0
    for m in range(n):
        s = np.array(A) @ s + np.outer(B, seen[m + DELAY]) + np.outer(C, seen[m])
        signs = []
        for _ in range(2):
            signs.append(1 if register % 2 else -1)
            register = register // 2 ^ (0xA3000000 if register % 2 else 0)
        current = schedule.get(m, current)
        if current:
            gain, bias = GAINS[current]
            g = np.float32(gain).astype(float).reshape(2, 4)
            u = g @ s.T.ravel() + bias + amplitude * np.array(signs)
            echo[m + latency + 1] = np.clip(np.round(u), -limit, limit)
    return echo[:n]


@dataclass
class Heard:
    """All that a board said: rows [vx, vy, ux, uy], and per block its flags and matrix."""

    rows: list[list[int]] = field(default_factory=list)
    flags: list[int] = field(default_factory=list)
    matrices: list[int] = field(default_factory=list)

    def add(self, messages: list[Message]) -> None:
        self.rows += codes(messages)
        self.flags += flags(messages)
        self.matrices += [m.matrix_id for m in messages if isinstance(m, Sense)]


def still(latency: int = 1) -> Scenario:
    """Noise and an offset on both axes, so that codes and drives are never trivial."""
    return scenario(
        {
            "drive": {"latency_samples": latency},
            "sense": {"adc_bits": 16, "noise_V": 1e-3, "opamp_offset_V": [1e-3, -2e-3]},
        }
    )


@pytest.mark.parametrize("latency", [0, 1, 3])
@pytest.mark.parametrize("amplitude", [0, 250])
def test_the_echo_is_the_law(latency: int, amplitude: int) -> None:
    """Matrices from the middle of blocks on, each replaced at its very tick; the third one runs into the limit."""
    what = still(latency)
    host = ready(what, **with_filter(DITHER_AMPLITUDE=amplitude, DITHER_SEED=0xC0FFEE11, DRIVE_LIMIT=20_000))
    heard = Heard()
    heard.add(host.say(Arm()))
    schedule = {23: 1, 77: 2, 80: 3}
    plan = {0: gains(1, 23), 1: gains(1, 40), 2: gains(2, 77), 3: gains(3, 80)}
    for block in range(12):
        heard.add(host.say(plan.get(block, gains(3, BLOCK * (block + 1)))))
    rows = np.array(heard.rows)
    np.testing.assert_array_equal(rows[:, 2:], expected(rows[:, :2], schedule, latency, 20_000, 0xC0FFEE11, amplitude))
    np.testing.assert_array_equal(Device(what).rows(rows[:, 2:]), rows[:, :2])
    assert heard.matrices == [0, 1, 1, 2, 3, 3, 3, 3, 3, 3, 3, 3, 3]
    assert np.abs(rows[:, 2:]).max() == 20_000
    assert set(heard.flags[:4]) == {0}
    assert heard.flags[5] == SenseFlags.SATURATED
    assert host.board.status().saturated > 0


def test_the_power_up_filter_is_the_pair() -> None:
    """u = V[m] − V[m − 1] of the x axis, by the matrix that says so."""
    host = ready(still())
    heard = Heard()
    heard.add(host.say(Arm()))
    for block in range(3):
        heard.add(host.say(DriveGains(9, (1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0), BLOCK * block + 20)))
    rows = np.array(heard.rows)
    np.testing.assert_array_equal(rows[BLOCK + 2 :, 2], np.diff(rows[:, 0])[BLOCK - 1 : -2])
    assert not rows[:, 3].any()


def test_time_passes_between_blocks_and_nothing_acts_on_the_past() -> None:
    """On wall time: a matrix heard at tick 27 of the block that began at 20 cannot have acted at 25."""
    host = ready(still(), ClockMode.PACED, **with_filter())
    host.say(Arm())
    heard = Heard()
    heard.add(host.tick())
    assert host.board.pass_time(27) == b""
    assert host.board.missing == 2 * BLOCK - 1 - 27
    host.say(gains(1, 25))
    assert host.board.pass_time(33) == b""
    host.say(gains(2, 36))
    assert host.board.pass_time(1000) == b""  # the last row is for the deadline
    assert host.board.missing == 1
    for _ in range(3):
        heard.add(host.tick())
    rows = np.array(heard.rows)
    assert len(rows) == 4 * BLOCK
    np.testing.assert_array_equal(rows[:, 2:], expected(rows[:, :2], {28: 1, 36: 2}, 1, 32767, 1, 0))
    assert host.board.status().late == 1


@pytest.mark.parametrize("by_time", [False, True])
def test_watchdog(by_time: bool) -> None:
    """So many ticks without a matrix: zero force within the block, SAFE, told in STATUS; SENSE ends."""
    host = ready(still(), ClockMode.PACED, **with_filter(WATCHDOG_TICKS=30, DITHER_AMPLITUDE=500))
    host.say(Arm())
    heard = Heard()
    heard.add(host.tick())
    host.say(gains(1, BLOCK))  # fed at tick 19
    heard.add(host.tick())
    assert host.board.state is State.RUNNING
    messages = host.heard(host.board.pass_time(58)) if by_time else host.tick()
    heard.add(messages)
    rows = np.array(heard.rows)
    assert len(rows) == 3 * BLOCK
    driven = np.flatnonzero(rows[:, 2:].any(axis=1))
    assert (driven[0], driven[-1]) == (BLOCK + 2, 19 + 30)  # the interval that begins at 49 is the first without
    (status,) = (m for m in messages if isinstance(m, Status))
    assert (status.state, status.reason, status.watchdog_trips) == (State.SAFE, SafeReason.WATCHDOG, 1)
    assert not host.board.streaming


def test_safe_and_arming_again_begin_anew() -> None:
    """No force after SAFE, and after ARM none until a matrix; filter and dither start as they did."""
    host = ready(still(), **with_filter(DITHER_AMPLITUDE=100, DITHER_SEED=77))
    host.say(Arm())
    host.say(gains(2, BLOCK))
    host.say(gains(2, 2 * BLOCK + 5))
    host.say(Safe(SafeReason.LINK_LOST))
    assert host.board.state is State.SAFE
    heard = Heard()
    heard.add(host.say(Arm()))
    heard.add(host.say(gains(1, 4 * BLOCK)))
    heard.add(host.say(gains(1, 5 * BLOCK)))
    rows = np.array(heard.rows)
    np.testing.assert_array_equal(rows[:, 2:], expected(rows[:, :2], {BLOCK: 1}, 1, 32767, 77, 100))
    assert heard.matrices == [0, 1, 1]


def test_the_largest_numbers_end_in_bounded_codes() -> None:
    """The filter that gains most, and the largest matrix."""
    host = ready(still(), FILTER_A11=0.98, FILTER_A12=16.0, FILTER_A22=0.98, FILTER_B1=16.0, FILTER_B2=16.0)
    host.say(Arm())
    most = 2.0**60
    heard = Heard()
    for block in range(30):
        gain = (most, -most, most, most, -most, most, -most, most)
        heard.add(host.say(DriveGains(1, gain, (most, -most), BLOCK * (block + 1))))
    rows = np.array(heard.rows)
    assert set(np.abs(rows[3 * BLOCK :, 2:]).ravel().tolist()) == {32767}
    assert nack(host.say(DriveGains(1, (2.0**61,) + (0.0,) * 7, (0.0, 0.0), 0))) is NackReason.OUT_OF_RANGE


def test_without_latency_the_board_needs_no_lockstep() -> None:
    host = ready(still(0), ClockMode.PACED, **with_filter())
    host.say(Arm())
    heard = Heard()
    heard.add(host.tick())
    host.say(gains(1, BLOCK))
    heard.add(host.tick())
    rows = np.array(heard.rows)
    np.testing.assert_array_equal(rows[:, 2:], expected(rows[:, :2], {BLOCK: 1}, 0, 32767, 1, 0))
