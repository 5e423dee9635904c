"""Trim electrodes of the emulator: softening by V², settling, codes, zero in SAFE whatever brought the board there."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.line import Line
from device_emulator.scenario import Scenario
from device_emulator.section import ScenarioError
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    DriveForce,
    Hello,
    Nack,
    NackReason,
    RegisterRead,
    RegisterValue,
    RegisterWrite,
    Safe,
    SafeReason,
    TrimOutput,
    TrimRead,
)
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter
from tests.emulator.gyro import AMPLITUDE_M, IDEAL, OMEGA, document, record, scenario, undriven

MASS = 1e-3
X = {"name": "x", "range_V": [0.0, 10.0], "settling_s": 0.0, "softening_N_per_m_per_V2": [0.4, 0.0, 0.0]}
SKEW = {"name": "q", "range_V": [-5.0, 5.0], "settling_s": 0.05, "softening_N_per_m_per_V2": [0.3, 0.2, -0.5]}
TRIM_0, TRIM_1, TRIM_2 = (SPEC.registers[f"TRIM_{k}"].id for k in range(3))
N = 4000


def swung(trims, volts, position=(AMPLITUDE_M, 0.0), n=N):
    """Positions (n, 2) of an undriven mass whose outputs step to `volts` after the first row."""
    pages = []
    what = scenario(IDEAL, {"truth": {"position_m": list(position)}, "trim": trims})
    device = Device(what, None, lambda _, rows: pages.append(rows.copy()))
    device.rows(undriven(1))
    for output, value in enumerate(volts):
        device.trim(output, value)
    device.rows(undriven(n - 1))
    device.close()
    return np.vstack(pages)[:, [0, 2]]


@pytest.mark.parametrize("volts", [0.0, 3.0, 10.0, -4.0])
def test_the_frequency_falls_by_the_square_of_the_voltage(volts):
    """Closed form: ω² = (k - c V²)/m, in the phase of 200 cycles; the sign of V does nothing."""
    t = np.arange(N) / 4000.0
    omega = math.sqrt(OMEGA**2 - 0.4 / MASS * volts**2)
    found = swung([X], [volts])[:, 0]
    np.testing.assert_allclose(found, AMPLITUDE_M * np.cos(omega * t), atol=2e-7 * AMPLITUDE_M)


def test_a_settling_skew_electrode_agrees_with_scipy():
    k, c = OMEGA**2 * np.eye(2), np.array([[0.3, -0.5], [-0.5, 0.2]]) / MASS

    def flow(t, s):
        volts = 4.0 * (1.0 - math.exp(-t / 0.05))
        return np.concatenate([s[2:], -(k - c * volts**2) @ s[:2]])

    t = np.arange(1000) / 4000.0
    start = [AMPLITUDE_M, 0.5 * AMPLITUDE_M, 0.0, 0.0]
    expected = solve_ivp(flow, (0.0, t[-1]), start, "DOP853", t, rtol=1e-12, atol=1e-18).y[:2].T
    found = swung([SKEW], [4.0], (AMPLITUDE_M, 0.5 * AMPLITUDE_M), len(t))
    np.testing.assert_allclose(found, expected, atol=1e-6 * AMPLITUDE_M)


def test_without_a_voltage_nothing_changes_to_the_last_bit():
    bare, trimmed = (record(scenario(change), undriven(500)).codes for change in ({}, {"trim": [X, SKEW]}))
    assert np.array_equal(bare, trimmed)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"range_V": [1.0, 5.0]}, "around 0"),
        ({"settling_s": -1.0}, "settling_s"),
        ({"softening_N_per_m_per_V2": [1.0]}, "softening"),
    ],
)
def test_an_impossible_output_is_refused(change, told):
    with pytest.raises((ScenarioError, ValueError), match=told):
        Scenario.model_validate(document({"trim": [X | change]}))


class Host:
    """The other end of a board in this process."""

    def __init__(self, **faults):
        what = scenario({"trim": [X, SKEW]}, {"faults": faults} if faults else {})
        self.device = Device(what)
        self.board = Board(what, self.device, (ClockMode.LOCKSTEP,))
        self._end = Line(self.board, what) if faults else self.board
        self._tx, self._rx = Transmitter(), Receiver()

    def ask(self, *messages):
        """What comes for them beside samples."""
        heard = []
        for message in messages:
            heard += self._rx.feed(self._end.exchange(self._tx.encode(message, 0)))
        return [item.message for item in heard if isinstance(item.message, RegisterValue | Nack | TrimOutput)]

    def running(self):
        self.ask(Hello(SPEC.protocol, SPEC.hash), RegisterWrite(SPEC.registers["WATCHDOG_TICKS"].id, 100), Arm())
        self.step(3)
        assert self.ask(RegisterWrite(TRIM_0, 30000))[0].value == 30000
        self.step(3)
        assert self.device.trim_V[0] > 4.0
        return self

    def step(self, n):
        for _ in range(n):
            self.ask(DriveForce(0, 0, self.board.tick + 1))

    def zero(self):
        self._rx.restart()  # a board that lost its supply counts from 0 again
        (value,) = self.ask(RegisterRead(TRIM_0))
        return value == RegisterValue(TRIM_0, 0) and self.device._records[3]["trim_target_V"][0, 0] == 0.0


def test_a_board_tells_what_its_outputs_are():
    host = Host()
    assert Capabilities.TRIM in Capabilities(host.board._identity.capabilities)
    first, second, none = host.ask(TrimRead(0), TrimRead(1), TrimRead(2))
    assert (first.name, first.outputs, first.lowest, first.settling_s) == ("x", 2, 0, 0.0)
    assert first.highest * first.scale_V == pytest.approx(10.0)
    assert (second.lowest * second.scale_V, second.settling_s) == (pytest.approx(-5.0, abs=1e-3), 0.05)
    assert none.name == ""


def test_a_code_is_bounded_and_taken_only_where_the_board_streams():
    host = Host()
    (refused,) = host.ask(RegisterWrite(TRIM_0, 1))
    assert refused.reason == NackReason.BAD_STATE
    host.running()
    for register, value, reason in (
        (TRIM_0, 70000, NackReason.OUT_OF_RANGE),
        (TRIM_0, -1, NackReason.OUT_OF_RANGE),
        (TRIM_0, 0.5, NackReason.OUT_OF_RANGE),
        (TRIM_0, math.nan, NackReason.OUT_OF_RANGE),
        (TRIM_2, 0, NackReason.UNKNOWN_REGISTER),
    ):
        (refused,) = host.ask(RegisterWrite(register, value))
        assert refused.reason == reason
    assert host.ask(RegisterRead(TRIM_0))[0].value == 30000


def test_every_way_into_safe_puts_the_outputs_to_zero():
    for stop in (
        lambda host: host.ask(Safe(SafeReason.HOST_REQUEST)),
        lambda host: host.ask(Safe(SafeReason.LINK_LOST)),
        lambda host: host.ask(Hello(SPEC.protocol, SPEC.hash)),  # a host that begins anew
        lambda host: host.board.fault(present=True),
        lambda host: host.board.hang_up(),
        lambda host: host.board.enter_safe(SafeReason.WATCHDOG),
        lambda host: host.board.power_up(),
    ):
        host = Host().running()
        stop(host)
        assert host.zero()
        (refused,) = host.ask(RegisterWrite(TRIM_0, 30000))
        assert refused.reason == NackReason.BAD_STATE, "not armed"


def test_the_electrode_settles_to_zero_after_safe():
    host = Host().running()
    host.ask(RegisterWrite(TRIM_1, 20000))
    host.step(400)
    before = host.device.trim_V[1]
    host.ask(Safe(SafeReason.HOST_REQUEST))
    host.board.coast(200)
    assert host.device.trim_V[1] == pytest.approx(before * math.exp(-200 / 4000.0 / 0.05), rel=1e-9)


def test_a_supply_that_is_lost_takes_the_voltages_with_it():
    host = Host(brown_out=[{"start_s": 0.01, "duration_s": 0.01}]).running()
    host.step(60)
    assert host.device.trim_V[0] == 0.0
    assert host.zero()
