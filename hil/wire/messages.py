"""The messages as named tuples, and their enumerations.

Written out so that readers, editors and type checkers know the names; sizes, order and numbers on the wire
come from `spec.toml`. `hil.wire.codec` compares the two and refuses to load if they differ.
"""

from enum import IntEnum, IntFlag
from typing import NamedTuple

from hil.wire.sense import Sense


class State(IntEnum):
    """States of the board."""

    BOOT = 0
    IDLE = 1
    ARMED = 2
    RUNNING = 3
    SAFE = 4


class SafeReason(IntEnum):
    """Why a board is, or should be, in SAFE."""

    NONE = 0
    HOST_REQUEST = 1
    INTERRUPTED = 2
    RESIDUAL = 3
    WATCHDOG = 4
    LINK_LOST = 5
    FAULT = 6


class NackReason(IntEnum):
    """Why an intact frame was refused."""

    UNKNOWN_TYPE = 1
    BAD_LENGTH = 2
    BAD_STATE = 3
    UNKNOWN_REGISTER = 4
    READ_ONLY = 5
    OUT_OF_RANGE = 6
    NOT_SUPPORTED = 7
    LATCHED = 8


class ClockMode(IntEnum):
    """What makes the board go on to the next tick."""

    LOCKSTEP = 0
    PACED = 1
    REAL = 2


class LoopMode(IntEnum):
    """Which drive messages close the loop."""

    FORCE = 0
    GAIN = 1
    BOARD = 2


class SenseFlags(IntFlag):
    """What happened within a SENSE block: a late answer (last drive held), a clipped converter, a limited
    drive."""

    HELD = 1
    CLIPPED = 2
    SATURATED = 4


class Capabilities(IntFlag):
    """What a board can do."""

    FORCE_MODE = 1
    GAIN_MODE = 2
    LOCKSTEP = 4
    PACED = 8
    BOARD_MODE = 16
    ESTIMATE = 32
    TRIM = 64


class EstimatedEntries(IntFlag):
    """Which entries of ESTIMATE a board's model estimates."""

    X = 1
    VX = 2
    Y = 4
    VY = 8
    PHI_X = 16
    PHI_Y = 32
    RATE = 64
    KXX = 128
    KYY = 256
    KXY = 512
    DXX = 1024
    DYY = 2048
    DXY = 4096
    ANGLE = 8192


class EstimateFlags(IntFlag):
    """What the numbers of ESTIMATE mean: a valid angle, a drive that is applied."""

    VALID = 1
    DRIVING = 2


class Safe(NamedTuple):
    """Zero force at once; `reason` is a `SafeReason`."""

    reason: int


class Arm(NamedTuple):
    """From IDLE or SAFE to ARMED: SENSE begins to stream."""


class DriveForce(NamedTuple):
    """Drive codes (int32) and the tick from which they act (low 32 bits)."""

    ux: int
    uy: int
    effective_tick: int


class DriveGains(NamedTuple):
    """Gain mode: `gain` 2 × 4 row by row (drive codes per sense code), `bias` (ux, uy) in drive codes, and the first
    tick computed with them (low 32 bits)."""

    matrix_id: int
    gain: tuple[float, ...]
    bias: tuple[float, ...]
    effective_tick: int


class DriveBoard(NamedTuple):
    """Board mode: the board may go on, and with `drive` = 1 applies what its estimator computes."""

    drive: int


class TimeSync(NamedTuple):
    """Clocks of both ends in ns; the host sends `board_ns` = 0."""

    host_ns: int
    board_ns: int


class Status(NamedTuple):
    """`State`, `SafeReason`, and what has been counted since power-up."""

    state: int
    reason: int
    late: int
    held: int
    bad_frames: int
    lost_seq: int
    saturated: int
    watchdog_trips: int
    dropped: int
    tick: int


class Nack(NamedTuple):
    """An intact frame was refused; `reason` is a `NackReason`."""

    of_type: int
    of_seq: int
    reason: int


class Hello(NamedTuple):
    """Opens a conversation."""

    protocol: int
    spec_hash: int


def version_of(firmware: int) -> str:
    """`Identity.firmware` in words: 0x00010203 is 1.2.3."""
    return ".".join(str(firmware >> shift & 0xFF) for shift in (16, 8, 0))


class Identity(NamedTuple):
    """Who the board is and what its codes are worth (volts per sense code, m/s² per drive code)."""

    protocol: int
    spec_hash: int
    unique_id: int
    firmware: int
    tick_rate_Hz: float
    axes: int
    sense_bits: int
    drive_bits: int
    sense_scale_V: float
    drive_scale_mps2: float
    latency_ticks: int
    capabilities: int

    @property
    def version(self) -> str:
        """The firmware's version in words, such as 1.2.3."""
        return version_of(self.firmware)


class RegisterRead(NamedTuple):
    """Asks for the value of a register."""

    register: int


class RegisterWrite(NamedTuple):
    """Sets a register."""

    register: int
    value: float


class RegisterValue(NamedTuple):
    """Value of a register now in force."""

    register: int
    value: float


class FieldRead(NamedTuple):
    """Asks for one line of the board's field table."""

    line: int


class FieldValue(NamedTuple):
    """One of the `lines` lines of the field table; `entry` is `FieldEntry.text`."""

    line: int
    lines: int
    entry: str


class Estimate(NamedTuple):
    """What a board's own estimator says after the sample of `tick` (low 32 bits), in SI; `estimated` are
    `EstimatedEntries`, `flags` `EstimateFlags`. Deviations are single precision."""

    tick: int
    estimated: int
    flags: int
    x: float
    vx: float
    y: float
    vy: float
    phi_x: float
    phi_y: float
    rate: float
    kxx: float
    kyy: float
    kxy: float
    dxx: float
    dyy: float
    dxy: float
    angle: float
    sd_x: float
    sd_vx: float
    sd_y: float
    sd_vy: float
    sd_phi_x: float
    sd_phi_y: float
    sd_rate: float
    sd_kxx: float
    sd_kyy: float
    sd_kxy: float
    sd_dxx: float
    sd_dyy: float
    sd_dxy: float
    sd_angle: float


class TrimRead(NamedTuple):
    """Asks what one trim output is, counted from 0."""

    output: int


class TrimOutput(NamedTuple):
    """A trim output of a board with `outputs` of them: its codes, volts per code, the time constant with which the
    electrode follows, and its name."""

    output: int
    outputs: int
    lowest: int
    highest: int
    scale_V: float
    settling_s: float
    name: str


Message = (
    Safe | Arm | DriveForce | DriveGains | DriveBoard | Sense | TimeSync | Status | Nack | Hello | Identity
    | RegisterRead | RegisterWrite | RegisterValue | FieldRead | FieldValue | Estimate | TrimRead | TrimOutput
)  # fmt: skip
