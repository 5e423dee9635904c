"""The gyro itself: drive chain, plant and sense chain as one machine that turns drive codes into sense codes.

    device = Device(load(path))
    codes = device.rows(drive_codes)          # (n, 2) in, (n, 2) out

Row m holds the sense codes sampled at tick m; its drive codes are held over the interval that ends at m.
Row 0 is the start: nothing came before it, so its drive codes do nothing.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from device_emulator import rate
from device_emulator.compiled import compiled
from device_emulator.drive import DRIVE, DRIVE_STATE, acting, drive_constants, put_out
from device_emulator.effects.catalogue import table
from device_emulator.effects.force import coriolis, lightness
from device_emulator.effects.sense import amplified, displacement, flip, shown, voltage
from device_emulator.feedback import due, feed_back
from device_emulator.plant import PLANT, STATES, parts, plant_constants, step, step_alone
from device_emulator.play import has_play, put_feet, step_with_play
from device_emulator.scenario import Scenario
from device_emulator.sense import (
    SENSE,
    SENSE_STATE,
    convert,
    delayed,
    history_rows,
    offset,
    sense_constants,
    start,
    track,
    upset,
    wander,
)
from device_emulator.temperature import warmer

PAGE = 64  # rows for which noise is drawn, and truth handed on, at a time

TRUTH_COLUMNS = ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s", "angle_rad")
CODE_COLUMNS = ("vx_code", "vy_code", "ux_code", "uy_code")

_CONSTANTS = np.dtype([("plant", PLANT), ("drive", DRIVE), ("sense", SENSE)], align=True)
_STATE = np.dtype(
    [
        ("tick", "i8"),  # of the last row, -1 before the first
        ("piece", "i8"),  # of the rate profile
        ("motion", "f8", STATES),  # x, ẋ, y, ẏ and what the effects have of their own
        ("stages", "f8", (8, STATES)),  # scratch of the integrator
        ("push", "f8", 6),
        ("seed", "i8"),
        ("drive", DRIVE_STATE),
        ("sense", SENSE_STATE),
    ],
    align=True,
)


class Device:
    """A gyro of one scenario; `seed` overrides the scenario's.

    The true states go to `sink(first_tick, rows)`: rows of shape (n ≤ PAGE, 12), columns `TRUTH_COLUMNS` and, as they
    were sent, `CODE_COLUMNS`.

    Attributes:
        tick: of the last row, -1 before the first.
        clipped: whether the converter clipped in the last call of `row` or `rows`.
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
        state["tick"] = -1
        x, y = scenario.truth.position_m
        vx, vy = scenario.truth.velocity_mps
        state["motion"][0, :4] = x, vx, y, vy
        state["seed"] = np.uint64(scenario.seed if seed is None else seed).astype(np.int64)
        history = np.zeros((history_rows(sense), 2))
        self._noise = np.zeros((PAGE, 2 * plant["substeps"][0] + 4 + 2 * sense["flicker_poles"][0]))
        self._drive = np.zeros((PAGE, 2), np.int32)
        self._sense = np.zeros((PAGE, 2), np.int32)
        self._truth = np.zeros((PAGE, len(TRUTH_COLUMNS)))
        self._arguments = (
            constants,
            table(scenario.effect),
            rate.pieces(scenario.rate),
            state,
            history,
            self._noise,
            self._drive,
            self._sense,
            self._truth,
        )
        self._random = np.random.default_rng(scenario.seed if seed is None else seed)
        self._sink = sink
        self._page: int | None = None  # first tick of the page in work
        self.tick = -1
        self.clipped = False

    def row(self, ux_code: int, uy_code: int) -> tuple[int, int]:
        """Sense codes (vx, vy) of the next row, after an interval under the drive codes given."""
        self.prepare()
        self.tick += 1
        place = self.tick % PAGE
        self._drive[place, 0] = ux_code
        self._drive[place, 1] = uy_code
        self.clipped = _advance(*self._arguments, place, 1)
        vx, vy = self._sense[place].tolist()
        return vx, vy

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
            self.clipped |= _advance(*self._arguments, place, n)
            sense_codes[done : done + n] = self._sense[place : place + n]
            self.tick += n
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
            self.clipped |= _advance_closed(*self._arguments, place, count, feedback)
            codes[done : done + count, :2] = self._sense[place : place + count]
            codes[done : done + count, 2:] = self._drive[place : place + count]
            self.tick += count
            done += count
        return codes

    def prepare(self) -> None:
        """Do now what the next row would wait for: hand on a full page and draw the noise of a new one."""
        following = self.tick + 1
        if following % PAGE == 0 and self._page != following:
            self._hand_on()
            self._page = following
            self._random.standard_normal(out=self._noise)

    def close(self) -> None:
        """Hand on the truth of the page in work. The device is at its end."""
        self._hand_on()
        self._sink = None

    def _hand_on(self) -> None:
        if self._sink is not None and self._page is not None and self.tick >= self._page:
            rows = slice(self._page % PAGE, self.tick % PAGE + 1)
            self._sink(self._page, np.hstack([self._truth[rows], self._sense[rows], self._drive[rows]]))


@compiled
def _advance(
    constants: NDArray[Any],
    hidden: NDArray[Any],
    pieces: NDArray[Any],
    states: NDArray[Any],
    history: NDArray[np.float64],
    noise: NDArray[np.float64],
    drive_codes: NDArray[np.int32],
    sense_codes: NDArray[np.int32],
    truth: NDArray[np.float64],
    first: int,
    n: int,
) -> bool:
    """Produce n rows of the page from row `first` on; True when the converter clipped."""
    plant, drive, sense = constants[0].plant, constants[0].drive, constants[0].sense
    state = states[0]
    motion = state.motion
    clipped = False
    for row in range(first, first + n):
        begins = state.tick < 0
        flip(hidden, state.seed, state.tick + 1, plant.ts_s, motion)
        if begins:
            start(hidden, state.sense, motion)
            put_feet(hidden, motion)
            _rewind(plant, hidden, pieces[0], state, history)
        else:
            put_out(drive, hidden, state.drive, state.tick + 1, drive_codes[row, 0], drive_codes[row, 1])
            _interval(plant, drive, sense, hidden, pieces, state, history, noise[row])
        state.tick += 1
        t = state.tick * plant.ts_s
        normals = noise[row, 2 * plant.substeps :]
        wander(sense, state.sense, normals[2:], begins)
        piece = pieces[state.piece]
        ux, uy = drive_codes[row, 0] * drive.lsb_mps2, drive_codes[row, 1] * drive.lsb_mps2
        vx, vy = voltage(hidden, t, warmer(plant.temperature, t), ux, uy, motion)
        seen = displacement(hidden, motion)
        for axis in range(2):
            moved, added = (seen[0], vx) if axis == 0 else (seen[2], vy)
            if sense.tracked:
                moved = delayed(history, state.sense.newest, axis, sense.delay_substeps[axis])
            phi = offset(sense, state.sense, t, axis)
            volts = amplified(hidden, axis, sense.gain_V_per_m[axis] * moved + phi + added)
            code, over = convert(sense, volts + sense.noise_V * normals[axis])
            sense_codes[row, axis] = upset(sense, state.sense, state.tick, axis, shown(hidden, code))
            clipped |= over
            truth[row, 4 + axis] = phi
        truth[row, :4] = motion[:4]
        truth[row, 6] = rate.rate_at(piece, t)[0]
        truth[row, 7] = rate.angle_at(piece, t)
    return clipped


@compiled
def _advance_closed(
    constants: NDArray[Any],
    hidden: NDArray[Any],
    pieces: NDArray[Any],
    states: NDArray[Any],
    history: NDArray[np.float64],
    noise: NDArray[np.float64],
    drive_codes: NDArray[np.int32],
    sense_codes: NDArray[np.int32],
    truth: NDArray[np.float64],
    first: int,
    n: int,
    feedback: NDArray[Any],
) -> bool:
    """`_advance` with each row's drive codes from the loop that is closed on the board."""
    loop = feedback[0]
    clipped = False
    for row in range(first, first + n):
        drive_codes[row, 0], drive_codes[row, 1] = due(loop, states[0].tick + 1)
        clipped |= _advance(constants, hidden, pieces, states, history, noise, drive_codes, sense_codes, truth, row, 1)
        feed_back(loop, states[0].tick, sense_codes[row, 0], sense_codes[row, 1])
    return clipped


@compiled
def _interval(
    plant: Any,
    drive: Any,
    sense: Any,
    hidden: NDArray[Any],
    pieces: NDArray[Any],
    state: Any,
    history: NDArray[np.float64],
    normals: NDArray[np.float64],
) -> None:
    """One sample interval of the mass; sub-steps are cut where the drive or the rate profile changes."""
    row = state.tick + 1
    t0 = state.tick * plant.ts_s
    h = plant.ts_s / plant.substeps
    change = _next_change(pieces, state.piece, t0)
    push = state.push
    felt = coriolis(hidden)
    playing = has_play(hidden)
    light = lightness(hidden)
    for k in range(plant.substeps):
        fx = plant.noise_xx * normals[2 * k]
        fy = plant.noise_yx * normals[2 * k] + plant.noise_yy * normals[2 * k + 1]
        since, end = k * h, (k + 1) * h
        while since < end:
            until = min(end, change)
            for axis in range(2):
                push[axis], push[2 + axis], steady = acting(drive, state.drive, row, axis, since)
                until = min(until, steady)
            push[4], push[5] = fx, light * fy
            piece = pieces[state.piece]
            if len(hidden) == 0:
                step_alone(plant, piece, t0 + since, until - since, push, state.motion)
            else:
                count = parts(plant, hidden, piece, t0 + since, until - since, push, state.motion)
                h_part = (until - since) / count
                for part in range(count):
                    at = since + part * h_part
                    if playing:
                        step_with_play(
                            plant, hidden, piece, t0 + at, h_part, push, plant.states, state.motion, state.stages
                        )
                    else:
                        step(plant, hidden, piece, t0 + at, h_part, push, plant.states, state.motion, state.stages)
                    push[0] += h_part * push[2]
                    push[1] += h_part * push[3]
            since = until
            # A change that rounding leaves just past the end of the interval belongs to its end.
            while change <= since * (1.0 + 1e-9):
                before = rate.rate_at(pieces[state.piece], t0 + change)[0]
                state.piece += 1
                jump = felt * (rate.rate_at(pieces[state.piece], t0 + change)[0] - before)
                state.motion[1] += jump * state.motion[2]
                state.motion[3] -= light * jump * state.motion[0]
                change = _next_change(pieces, state.piece, t0)
        if sense.tracked:
            track(sense, hidden, state.sense, history, state.motion)


@compiled
def _next_change(pieces: NDArray[Any], piece: int, t0: float) -> float:
    """Seconds from t0 to the next piece of the rate profile."""
    return pieces[piece + 1].start_s - t0 if piece + 1 < len(pieces) else np.inf


@compiled
def _rewind(plant: Any, hidden: NDArray[Any], piece: Any, state: Any, history: NDArray[np.float64]) -> None:
    """Fill the history with the undriven motion before tick 0, so that a delay finds something to show.

    States of the effects' own stay: they begin at tick 0.
    """
    motion = state.motion.copy()
    state.push[:] = 0.0
    h = plant.ts_s / plant.substeps
    rows = history.shape[0]
    for back in range(rows):
        seen = displacement(hidden, motion)
        history[rows - 1 - back, 0] = seen[0]
        history[rows - 1 - back, 1] = seen[2]
        step(plant, hidden, piece, -back * h, -h, state.push, 4, motion, state.stages)
    state.sense.newest = rows - 1
