"""Drive chain: codes to force per unit mass, held over a sample interval, and the queue in front of it."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator import effects
from device_emulator.compiled import compiled
from device_emulator.scenario import MAX_DELAY_SAMPLES, Scenario

RECENT = MAX_DELAY_SAMPLES + 2

DRIVE = np.dtype(
    [
        ("lsb_mps2", "f8"),
        ("delay_samples", "i8", 2),  # whole samples of the delay
        ("delay_rest_s", "f8", 2),  # and what is left of it
    ],
    align=True,
)

# Forces of the last intervals, by row number.
DRIVE_STATE = np.dtype([("recent", "f8", (RECENT, 2))], align=True)


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
    for axis, delay in enumerate(effects.delay_s(scenario.effect, effects.Kind.DRIVE_DELAY)):
        whole = math.floor(delay * scenario.board.sample_rate_Hz)
        c["delay_samples"][axis] = whole
        c["delay_rest_s"][axis] = delay - whole / scenario.board.sample_rate_Hz
    return constants


@compiled
def put_out(drive: Any, hidden: NDArray[Any], state: Any, row: int, ux_code: int, uy_code: int) -> None:
    """Enter the force of the interval that ends at `row`."""
    ux, uy = effects.drive(hidden, ux_code * drive.lsb_mps2, uy_code * drive.lsb_mps2)
    state.recent[row % RECENT, 0] = ux
    state.recent[row % RECENT, 1] = uy


@compiled
def acting(drive: Any, state: Any, row: int, axis: int, since_s: float) -> float:
    """Force per unit mass on one axis, `since_s` after the start of the interval that ends at `row`."""
    back = drive.delay_samples[axis]
    if since_s < drive.delay_rest_s[axis]:
        back += 1
    force: float = state.recent[(row - back) % RECENT, axis]
    return force


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

    def clear(self) -> None:
        """Forget every command: zero force."""
        self._waiting.clear()
        self.held = (0, 0, False)
