"""Records that Python and the core share (layout.h): settings (written once), memory (carried from sample to sample),
output (one row a sample).

All numbers are scaled: time by 1/ω0, length by the nominal amplitude.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Record = NDArray[np.void]  # one row of a dtype below

MAX_LATENCY = 15
MAX_AXES = 2
MAX_EFFECTS = 64  # carried and watched
MAX_SIGNALS = 96
MAX_SLIPS = 4  # signals that depend on the way
MAX_DEGREE = 8  # terms of a drive polynomial that are kept for a delay
MAX_DELAY = 8  # samples
MAX_ENTRIES = 4 + 9 + 2 * MAX_EFFECTS  # of the state vector of a two-axis gyro

# Order of the constants in the gyro's state vector; tests hold it equal to the declaration.
PHI_X, PHI_Y, RATE, KXX, KYY, KXY, DXX, DYY, DXY = range(9)

SETTINGS = np.dtype(
    [
        ("model", "i8"),
        ("states", "i8"),
        ("sense_constants", "i8"),
        ("flow_constants", "i8"),
        ("axes", "i8"),
        ("effect_count", "i8"),
        (
            "effects",
            "i8",
            (MAX_EFFECTS, 3),
        ),  # number of each, index of its first coefficient among the constants, of its first signal
        ("candidate_count", "i8"),  # effects behind those that are watched and not carried
        ("pushes", "i8"),  # effects among them that are forces
        ("kinked", "i8"),  # a force depends on the direction of motion, or on the way
        ("signal_count", "i8"),
        ("signals", "i8", (MAX_SIGNALS, 3)),  # source of each, its axis, index of its coefficient among the constants
        ("signal_parameters", "f8", (MAX_SIGNALS, 2)),  # a constant's value in the first
        ("slip_count", "i8"),
        (
            "slips",
            "i8",
            (MAX_SLIPS, 4),
        ),  # signals that depend on the way: their number, axis, index of the reach, and their source
        ("sense_delay", "i8"),  # index of its first coefficient among the constants, −1 without
        ("drive_delay", "i8"),
        ("watched_sense_delay", "i8"),  # the same of effects that are watched and not carried
        ("watched_drive_delay", "i8"),
        ("h", "f8"),  # sample interval
        ("order", "i8"),  # of the Taylor flow
        ("fade", "f8"),  # factor on the predicted covariance, 1 without fading
        ("two_covariances", "i8"),  # 1: the actual covariance C is carried beside P
        ("stationary", "i8"),  # 1: gains from the table, no Riccati recursion from then on
        ("takeover", "f8"),  # time from which the table is used
        ("sensed", "i8", (MAX_AXES,)),  # what a channel shows: 0 displacement, 1 velocity, 2 acceleration
        ("noise", "f8", (MAX_AXES,)),  # variance of the measurement
        ("ignored", "f8", (MAX_AXES,)),  # variance of what may be in it and is not estimated
        ("force_noise", "f8", (MAX_AXES,)),  # velocity variance per unit of time
        # controller
        ("control", "i8"),
        ("latency", "i8"),
        ("stiffness", "f8"),  # target k
        ("energy", "f8"),  # target ½ k A²
        ("energy_gain", "f8"),
        ("quadrature_gain", "f8"),
        ("virtual_rate", "f8"),
        ("reversal", "f8"),  # time between reversals of the virtual rotation, 0: never
        ("dither", "f8"),
        ("modulation", "f8"),
        ("modulation_rate", "f8"),
        ("hold", "f8"),  # sinc(ω Ts / 2), what the sample-and-hold leaves of a force
        ("force_limit", "f8"),
        ("quantum", "f8"),  # force of one drive code
        ("sense_scale", "f8", (MAX_AXES,)),  # position of one sense code
        # angle
        ("angular_gain", "f8"),  # rotation of the pattern over that of the board
        ("reference", "f8"),  # time from which on the angle's uncertainty counts
        ("open_loop", "i8"),  # 1: no drive makes the pattern an angle; it is the integrated rate
        ("rate_row", "i8"),  # of the rate among states and active constants
    ],
    align=True,
)

MEMORY = np.dtype(
    [
        ("time", "f8"),
        ("cursor", "i8"),  # which constant the regularised forgetting visits next
        ("nis", "f8"),  # smoothed normalised innovation squared, 1 when all is well
        ("started", "i8"),
        ("dither", "u8"),  # state of the xorshift generator
        ("theta", "f8"),  # pattern angle, unwrapped
        ("theta_zero", "f8"),
        ("theta_plain", "f8"),
        ("theta_plain_zero", "f8"),
        ("rotation", "f8"),  # Ω̂ + Ωv that theta was read with
        ("rate", "f8"),  # Ω̂ of the same
        ("forced", "f8"),  # rotation of the pattern by forces
        ("rate_integral", "f8"),
        ("virtual_integral", "f8"),
        ("virtual_applied", "f8"),
        ("gradient", "f8", (4,)),  # of the pattern angle by the states
        ("referred", "i8"),  # 1: the reference instant is past
        ("angle_variance", "f8"),  # of the pattern's rotation since then
        ("angle_cross", "f8", (MAX_ENTRIES,)),  # its covariance with states and active constants
        ("temperature", "f8"),  # above the first reading
        ("signals", "f8", (MAX_SIGNALS, 2)),  # value, and what else its recursion carries
        ("past", "f8", (MAX_DELAY + 1, MAX_AXES, MAX_DEGREE)),  # drives of the intervals before, newest first
        ("queue", "f8", (MAX_LATENCY + 1, 3)),  # commanded ux, uy and the virtual rate in them, oldest first
    ],
    align=True,
)

OUTPUT = np.dtype(
    [
        ("nu", "f8", (MAX_AXES,)),  # innovation
        ("s", "f8", (MAX_AXES,)),  # its predicted variance
        ("angle", "f8"),  # reported rotation φ, rad
        ("angle_variance", "f8"),  # of the estimate, since the reference instant
        ("angle_forced", "f8"),  # what was taken off for forces
        ("angle_pattern", "f8"),  # −(θ − θ0) − ∫Ωv dt, what an ideal control would make equal to it
        ("angle_plain", "f8"),  # the same from the source's formula (11)
        ("angle_rate_integral", "f8"),  # ∫Ω̂ dt
        ("energy_ratio", "f8"),
        ("quadrature_ratio", "f8"),
    ],
    align=True,
)
