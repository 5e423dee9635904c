"""Whether the sense voltages of a record can be those of the bench file."""

import numpy as np

from hil.bench import Bench
from hil.bench.ratio import slip
from hil.numbers import quantity, significant
from hil.records.capture import Capture

_FAR = 30.0
"""No mass swings so many times its declared amplitude. Far below it there are free decays and noise: the ratio has
to be that of a known slip there."""


def swing_slip(record: Capture, bench: Bench) -> str:
    """What to check where the vibration over the whole record is far from the declared amplitude; "" where it is not,
    and for demodulated streams and envelopes.
    """
    if record.carrier_Hz is not None or bench.device.sense.is_envelope or not len(record):
        return ""
    swing_V = np.array(bench.swing_V)
    mean, square = np.zeros(len(swing_V)), np.zeros(len(swing_V))
    with np.errstate(over="ignore", invalid="ignore"):
        for piece in record.pieces():
            share = piece.sense_V / swing_V
            mean += share.sum(axis=0) / len(record)
            square += (share * share).sum(axis=0) / len(record)
        ratio = float(np.sqrt(2.0 * np.sum(square - mean * mean)))
    guess = slip(ratio)
    if not (ratio >= _FAR or (guess and ratio <= 1.0 / _FAR)):
        return ""
    given = quantity(float(swing_V.max()), bench.device.sense.unit)
    near = f" (near {guess})" if guess else ""
    imported = record.header.get("identity") is None
    what = "the unit of vx_V and vy_V in the map" if imported else "[device.sense] gain_V_per_m"
    return f"the sense voltages are {significant(ratio)} × what the bench file can give, {given}{near}; check {what}"
