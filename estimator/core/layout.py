"""Records that Python and the core share, as layout.h declares them: settings (written once), memory (carried from
sample to sample), output (one row a sample), trims of an observer, a board in gain mode.

All numbers are scaled: time by 1/ω0, length by the nominal amplitude.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.core.declared import Header

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Record = NDArray[np.void]  # one row of a dtype below

_HERE = Path(__file__).parent
_HEADER = Header(_HERE / "layout.h", {})

NUMBERS = _HEADER.numbers
"""That it defines, by name."""
MAX_LATENCY, MAX_AXES, MAX_EFFECTS, MAX_SIGNALS, MAX_SLIPS, MAX_DEGREE, MAX_DELAY, MAX_ENTRIES, MAX_TRIMS = (
    NUMBERS[f"MAX_{name}"]
    for name in ("LATENCY", "AXES", "EFFECTS", "SIGNALS", "SLIPS", "DEGREE", "DELAY", "ENTRIES", "TRIMS")
)

# Order of the constants in the gyro's state vector; tests hold it equal to the declaration.
PHI_X, PHI_Y, RATE, KXX, KYY, KXY, DXX, DYY, DXY = range(9)

SETTINGS, MEMORY, OUTPUT, TRIMS = (_HEADER.row(name) for name in ("Settings", "Memory", "Output", "Trims"))
BOARD = Header(_HERE / "gain_board.h", NUMBERS).row("Board")
