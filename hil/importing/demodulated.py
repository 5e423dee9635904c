"""A lock-in's streams: in-phase and quadrature components of two channels, against a carrier of one frequency, or of
the one that its column tells.

X and Y are the components of X cos φ − Y sin φ, with φ the carrier's phase: Y leads, as lock-ins have it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.channels import COMPONENTS, DRIVEN, names_fault
from hil.importing.mapping import RecordMap
from hil.importing.source import Source
from hil.importing.uniformity import Numbered

Floats = npt.NDArray[np.float64]

CARRIER = "carrier_Hz"
BESIDE = ("t_s", CARRIER, "rate_rad_s", "temp_C")


class Carrier(NamedTuple):
    """What was asked for: a frequency, or the column that has it."""

    hertz: float | None
    column: str = CARRIER


def carrier_of(asked: str | float | None) -> Carrier | None:
    """`--demodulated`: a number of Hz, or a name.  Raises InputError for a number that is no frequency."""
    if asked is None:
        return None
    try:
        hertz = float(asked)
    except ValueError:
        return Carrier(None, str(asked))
    if not (math.isfinite(hertz) and hertz > 0.0):
        raise InputError(f"--demodulated: {asked} is no frequency; give the carrier in Hz, or the column that has it")
    return Carrier(hertz)


def components_fault(names: Sequence[str], carrier: Carrier, *, needs_time: bool) -> str | None:
    """What is wrong with this set of channels, with the remedy; None where it can be a record."""
    known = (*COMPONENTS, *BESIDE)
    if fault := names_fault(names, known, known, needs_time=needs_time, beside=" beside --demodulated"):
        return fault
    for axis in "xy":
        for part in "iq":
            if f"v{axis}_{part}_V" not in names:
                return f"no column v{axis}_{part}_V; --demodulated takes both components of both axes"
    driven = {name for name in names if name in DRIVEN}
    units = {name.rsplit("_", 1)[1] for name in driven}
    if len(units) > 1:
        return f"drives in {' and '.join(sorted(units))}; give all components in one unit"
    for unit in units:
        if lacking := [name for name in DRIVEN if name.endswith(f"_{unit}") and name not in driven]:
            return f"no column {lacking[0]} beside {min(driven)}; a drive has both components of both axes, or none"
    if carrier.hertz is not None and CARRIER in names:
        return f"column {CARRIER} beside --demodulated {carrier.hertz:g}; give --demodulated {CARRIER}, or leave it out"
    return None


def require_streams(source: Source, mapping: RecordMap, time: Numbered) -> None:
    """InputError for what demodulated streams cannot be done."""
    for key, given in (("steady", mapping.steady), ("[filter]", mapping.filter is not None)):
        if given:
            raise InputError(f"{source.called}: {key} is for samples, no demodulated streams; leave one of them out")
    if not time.uniform:
        raise InputError(f"{source.called}: demodulated streams need even steps; resample them in the lock-in")


def on_one_carrier(
    source: Source, channels: dict[str, Floats], time: Numbered, carrier: Carrier
) -> tuple[dict[str, Floats], float]:
    """The channels (n,) against one carrier, and its frequency: components against one that its column tells are turned
    on by the phase between them.  Raises InputError for a column that has no frequencies.
    """
    if carrier.hertz is not None:
        return channels, carrier.hertz
    kept = {name: values for name, values in channels.items() if name != CARRIER}
    hertz = channels[CARRIER]
    if (bad := np.flatnonzero(~(hertz > 0.0))).size:
        row = int(bad[0])
        raise InputError(f"{source.called}: {carrier.column}: {hertz[row]:g} Hz of kept row {row} is no carrier")
    mean = float(np.mean(hertz))
    off, steps = hertz - mean, np.diff(time.tick) / time.rate_Hz
    turn = np.exp(2j * np.pi * np.concatenate([[0.0], np.cumsum(0.5 * (off[1:] + off[:-1]) * steps)]))
    for name in [name for name in kept if "_i_" in name]:
        other = name.replace("_i_", "_q_")
        turned = (kept[name] + 1j * kept[other]) * turn
        kept[name], kept[other] = turned.real, turned.imag
    return kept, mean
