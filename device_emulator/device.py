"""The gyro itself: drive chain, plant and sense chain as one machine that turns drive codes into sense codes.

    device = Device(load(path))
    codes = device.rows(drive_codes)          # (n, 2) in, (n, 2) out

Row m holds the sense codes sampled at tick m; its drive codes are held over the interval that ends at m.
Row 0 is the start: nothing came before it, so its drive codes do nothing.
"""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from device_emulator import native, rate
from device_emulator.drive import DRIVE, DRIVE_STATE, drive_constants
from device_emulator.effects.catalogue import EFFECT, table
from device_emulator.effects.kinds import NAMES
from device_emulator.feedback import FEEDBACK
from device_emulator.flicker import MAX_FLICKER_POLES
from device_emulator.plant import PLANT, STATES, plant_constants
from device_emulator.scenario import Scenario
from device_emulator.sense import SENSE, SENSE_STATE, history_rows, sense_constants
from device_emulator.trim import MAX_TRIMS

PAGE = 64  # rows for which noise is drawn, and truth handed on, at a time

TRUTH_COLUMNS = ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s", "angle_rad")
STIFFNESS_COLUMNS = ("kxx_per_s2", "kyy_per_s2", "kxy_per_s2")  # of a device with trim electrodes
CODE_COLUMNS = ("vx_code", "vy_code", "ux_code", "uy_code")

_CONSTANTS = np.dtype([("plant", PLANT), ("drive", DRIVE), ("sense", SENSE)], align=True)
_STATE = np.dtype(
    [
        ("tick", "i8"),  # of the last row, -1 before the first
        ("piece", "i8"),  # of the rate profile
        ("page", "i8"),  # first tick of the page whose noise is drawn, -1 before the first
        ("motion", "f8", STATES),  # x, ẋ, y, ẏ and what the effects have of their own
        ("seed", "i8"),
        ("drive", DRIVE_STATE),
        ("sense", SENSE_STATE),
        ("flicker", "f8", MAX_FLICKER_POLES),  # of the bias
        ("drift_rad_s", "f8"),  # their sum
        ("trim_V", "f8", MAX_TRIMS),  # of the electrodes
        ("trim_target_V", "f8", MAX_TRIMS),  # of their outputs
    ],
    align=True,
)


native.require_same(
    NAMES,
    (
        *(record.itemsize for record in (_CONSTANTS, _STATE, EFFECT, rate.PIECE, FEEDBACK)),
        ctypes.sizeof(native.DeviceArguments),
        native.COMMAND.itemsize,
        ctypes.sizeof(native.BoardState),
    ),
)


class Device:
    """A gyro of one scenario; `seed` overrides the scenario's.

    The true states go to `sink(first_tick, rows)`: rows of shape (n ≤ PAGE, 12), columns `TRUTH_COLUMNS` and, as they
    were sent, `CODE_COLUMNS`; with trim electrodes 15, `STIFFNESS_COLUMNS` behind them.

    Attributes:
        address: of what C has of it.
        clipped: whether the converter clipped in the last call of `rows` or `closed_rows`.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int | None = None,
        sink: Callable[[int, NDArray[np.float64]], None] | None = None,
    ) -> None:
        constants = np.zeros(1, _CONSTANTS)
        constants["plant"] = plant = plant_constants(scenario)
        constants["drive"] = drive_constants(scenario)
        constants["sense"] = sense = sense_constants(scenario, plant["ts_s"][0] / plant["substeps"][0])
        state = np.zeros(1, _STATE)
        state["tick"] = state["page"] = -1
        x, y = scenario.truth.position_m
        vx, vy = scenario.truth.velocity_mps
        state["motion"][0, :4] = x, vx, y, vy
        state["seed"] = np.uint64(scenario.seed if seed is None else seed).astype(np.int64)
        history = np.zeros((history_rows(sense), 2))
        wandering = 2 * constants["drive"]["flicker"]["poles"][0] + plant["flicker"]["poles"][0]
        self._noise = np.zeros((PAGE, 2 * plant["substeps"][0] + 4 + 2 * sense["flicker_poles"][0] + wandering))
        self._drive = np.zeros((PAGE, 2), np.int32)
        self._sense = np.zeros((PAGE, 2), np.int32)
        self._truth = np.zeros((PAGE, len(TRUTH_COLUMNS) + len(STIFFNESS_COLUMNS)))
        self._trimmed = bool(scenario.trim)
        self._records = constants, table(scenario.effect), rate.pieces(scenario.rate), state, history
        self._point()
        self._random = np.random.default_rng(scenario.seed if seed is None else seed)
        self._sink = sink
        self.clipped = False

    def _point(self) -> None:
        """Tell the C side where the arrays are."""
        constants, effects, pieces, state, history = self._records
        self._arguments = native.DeviceArguments(
            constants.ctypes.data,
            effects.ctypes.data,
            len(effects),
            pieces.ctypes.data,
            len(pieces),
            state.ctypes.data,
            history.ctypes.data,
            len(history),
            self._noise.ctypes.data,
            self._noise.shape[1],
            self._drive.ctypes.data,
            self._sense.ctypes.data,
            self._truth.ctypes.data,
        )
        self.address = ctypes.addressof(self._arguments)
        self._tick = ctypes.c_int64.from_address(state.ctypes.data)  # its first field

    def __getstate__(self) -> dict[str, Any]:
        """All but addresses, which mean nothing elsewhere."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_arguments", "address", "_tick")}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        self.__dict__.update(kept)
        self._point()

    @property
    def tick(self) -> int:
        """Of the last row, -1 before the first."""
        return self._tick.value

    def rows(self, drive_codes: ArrayLike) -> NDArray[np.int32]:
        """Sense codes of the next n rows, shape (n, 2), for drive codes of the same shape."""
        drive_codes = np.asarray(drive_codes, np.int32)
        sense_codes = np.empty_like(drive_codes)
        self.clipped = False
        done = 0
        while done < len(drive_codes):
            self.prepare()
            place = (self.tick + 1) % PAGE
            n = min(PAGE - place, len(drive_codes) - done)
            self._drive[place : place + n] = drive_codes[done : done + n]
            self.clipped |= bool(native.advance(self.address, place, n))
            sense_codes[done : done + n] = self._sense[place : place + n]
            done += n
        return sense_codes

    def closed_rows(self, feedback: NDArray[Any], n: int) -> NDArray[np.int32]:
        """The next n rows with the loop closed on the board: (n, 4), sense codes and the drive codes that acted.

        `feedback` (1,) of dtype `FEEDBACK` is carried along.
        """
        codes = np.empty((n, 4), np.int32)
        self.clipped = False
        done = 0
        while done < n:
            self.prepare()
            place = (self.tick + 1) % PAGE
            count = min(PAGE - place, n - done)
            self.clipped |= bool(native.advance_closed(self.address, place, count, feedback.ctypes.data))
            codes[done : done + count, :2] = self._sense[place : place + count]
            codes[done : done + count, 2:] = self._drive[place : place + count]
            done += count
        return codes

    def prepare(self) -> None:
        """Do now what the next row would wait for: hand on a full page and draw the noise of a new one."""
        following = self.tick + 1
        state = self._records[3]
        if following % PAGE == 0 and state["page"][0] != following:
            self._hand_on()
            state["page"] = following
            self._random.standard_normal(out=self._noise)

    def trim(self, output: int, volts: float) -> None:
        """Put another voltage out to an electrode, which follows from the next interval on."""
        self._records[3]["trim_target_V"][0, output] = volts

    @property
    def trim_V(self) -> NDArray[np.float64]:
        """Voltages of the electrodes (MAX_TRIMS,)."""
        return np.asarray(self._records[3]["trim_V"][0].copy())

    def close(self) -> None:
        """Hand on the truth of the page in work. The device is at its end."""
        self._hand_on()
        self._sink = None

    def _hand_on(self) -> None:
        page = int(self._records[3]["page"][0])
        if self._sink is not None and 0 <= page <= self.tick:
            rows = slice(page % PAGE, self.tick % PAGE + 1)
            states, springs = np.split(self._truth[rows], [len(TRUTH_COLUMNS)], axis=1)
            more = [springs] if self._trimmed else []
            self._sink(page, np.hstack([states, self._sense[rows], self._drive[rows], *more]))
