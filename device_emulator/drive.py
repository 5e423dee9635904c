"""Drive chain: codes to force per unit mass, held over a sample interval, and the queue in front of it."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.compiled import compiled
from device_emulator.effects.catalogue import delay_s, slew_mps3
from device_emulator.effects.drive import DriveKind
from device_emulator.effects.drive import drive as reaching
from device_emulator.scenario import MAX_DELAY_SAMPLES, Scenario

RECENT = MAX_DELAY_SAMPLES + 2

DRIVE = np.dtype(
    [
        ("lsb_mps2", "f8"),
        ("delay_samples", "i8", 2),  # whole samples of the delay
        ("delay_rest_s", "f8", 2),  # and what is left of it
        ("ts_s", "f8"),
        ("slew_mps3", "f8", 2),
    ],
    align=True,
)

# Forces of the last intervals, by row number and axis: each runs from `start` with `slope` until `reach_s`, then stays.
DRIVE_STATE = np.dtype(
    [
        ("recent", "f8", (RECENT, 2)),
        ("start", "f8", (RECENT, 2)),
        ("slope", "f8", (RECENT, 2)),
        ("reach_s", "f8", (RECENT, 2)),
    ],
    align=True,
)


def drive_scale(scenario: Scenario) -> float:
    """One drive code in m/s²."""
    return math.ldexp(scenario.drive.full_scale_mps2, 1 - scenario.drive.dac_bits)


def drive_code_max(scenario: Scenario) -> int:
    """Largest code of the converter; the range is symmetric, so that a force can be turned round exactly."""
    return (1 << (scenario.drive.dac_bits - 1)) - 1


def drive_constants(scenario: Scenario) -> NDArray[Any]:
    """The chain as its kernels read it, shape (1,) of dtype `DRIVE`."""
    constants = np.zeros(1, DRIVE)
    c = constants[0]
    c["lsb_mps2"] = drive_scale(scenario)
    c["ts_s"] = 1.0 / scenario.true_rate_Hz
    c["slew_mps3"] = slew_mps3(scenario.effect)
    for axis, delay in enumerate(delay_s(scenario.effect, DriveKind.DRIVE_DELAY)):
        whole = math.floor(delay * scenario.true_rate_Hz)
        c["delay_samples"][axis] = whole
        c["delay_rest_s"][axis] = delay - whole / scenario.true_rate_Hz
    return constants


@compiled
def put_out(drive: Any, hidden: NDArray[Any], state: Any, row: int, ux_code: int, uy_code: int) -> None:
    """Enter the force of the interval that ends at `row`."""
    ux, uy = reaching(hidden, ux_code * drive.lsb_mps2, uy_code * drive.lsb_mps2)
    this, last = row % RECENT, (row - 1) % RECENT
    for axis in range(2):
        target = ux if axis == 0 else uy
        slew = drive.slew_mps3[axis]
        # `recent` is what the interval ends with, which the next one starts from.
        start = state.recent[last, axis]
        far = target - start
        if abs(far) > slew * drive.ts_s:
            target = start + math.copysign(slew * drive.ts_s, far)
        state.start[this, axis] = start
        state.slope[this, axis] = math.copysign(slew, far) if np.isfinite(slew) and far != 0.0 else 0.0
        state.reach_s[this, axis] = abs(target - start) / slew
        state.recent[this, axis] = target


@compiled
def acting(drive: Any, state: Any, row: int, axis: int, since_s: float) -> tuple[float, float, float]:
    """(force per unit mass, its slope, until when) on one axis, `since_s` after the start of the interval that ends at
    `row`; until when counts from that start, and the end of the interval is for the caller to see.
    """
    began = drive.delay_rest_s[axis]  # of the command's interval, late by its delay
    back = drive.delay_samples[axis]
    until = np.inf
    if since_s < began:
        until = began
        began -= drive.ts_s
        back += 1
    place = (row - back) % RECENT
    reached = began + state.reach_s[place, axis]
    if since_s < reached:
        slope = state.slope[place, axis]
        return state.start[place, axis] + slope * (since_s - began), slope, min(until, reached)
    return state.recent[place, axis], 0.0, until


class Schedule:
    """Commands waiting for their tick, and the one that is held.

    A command of effective tick e acts on the interval from e to e + 1 and is held until the next one.
    """

    __slots__ = ("_waiting", "held")

    def __init__(self) -> None:
        self._waiting: dict[int, tuple[int, int, bool]] = {}
        self.held = (0, 0, False)
        """ux code, uy code, whether they had to be limited."""

    def put(self, effective_tick: int, ux_code: int, uy_code: int, limited: bool) -> None:
        """Queue a command; a second one for the same tick replaces the first."""
        self._waiting[effective_tick] = (ux_code, uy_code, limited)

    def take(self, tick: int) -> bool:
        """Begin the interval that starts at `tick`; True if a command came into force."""
        command = self._waiting.pop(tick, None)
        if command is None:
            return False
        self.held = command
        return True

    def limit(self, code: int) -> None:
        """Bring the command that is held, and those that wait, within ± `code`."""
        self.held = _within(self.held, code)
        self._waiting = {tick: _within(command, code) for tick, command in self._waiting.items()}

    def clear(self) -> None:
        """Forget every command: zero force."""
        self._waiting.clear()
        self.held = (0, 0, False)


def _within(command: tuple[int, int, bool], code: int) -> tuple[int, int, bool]:
    ux, uy, limited = command
    bounded = max(-code, min(ux, code)), max(-code, min(uy, code))
    return *bounded, limited or bounded != (ux, uy)
