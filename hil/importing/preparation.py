"""From the channels of a map to those of a capture: a base becomes a force, the filter runs, and both are told.

A base that moves: its displacement, velocity or acceleration as the force that it is on the mass.

Beside its base a mass feels −a of the base as a force per unit mass.  What is not an acceleration is differentiated, by
a spline of degree 7 through the samples.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.importing.channels import OWN, SENSED
from hil.importing.mapping import RecordMap
from hil.importing.uniformity import Numbered
from hil.importing.units import MOTIONS, NAMES
from hil.records.capture import Hold

Floats = npt.NDArray[np.float64]
Channels = dict[str, Floats]


class Prepared(NamedTuple):
    """Channels as a capture has them, their segments and rate, and what its header is to say of them."""

    channels: Channels
    segments: dict[str, tuple[int, int]]
    rate_Hz: float
    told: dict[str, Any]


def prepared(
    channels: Mapping[str, Floats],
    segments: Mapping[str, tuple[int, int]],
    hold: Hold,
    time: Numbered,
    mapping: RecordMap,
) -> Prepared:
    """What `mapping` asks for, done to channels in SI, `t_s` among them. Raises ValueError with key and remedy."""
    said: list[str] = []
    made = _on_its_base(dict(channels), hold, time, mapping, said)
    told: dict[str, Any] = {"covariates": dict(mapping.covariates)} if mapping.covariates else {}
    made = {SENSED.get(name, name): values for name, values in made.items()}
    result = Prepared(made, dict(segments), time.rate_Hz, told)
    if mapping.filter is not None:
        result = _in_its_band(result, hold, time, mapping, said)
    if said:
        result.told["prepared"] = said
    return result


def _on_its_base(channels: Channels, hold: Hold, time: Numbered, mapping: RecordMap, said: list[str]) -> Channels:
    motion, sources = mapping.base_motion, mapping.channels
    if motion is None:
        return channels
    if hold == "zoh":
        raise ValueError('hold: a base moves between its samples; "bandlimited" or "foh"')
    values = channels.pop("base")
    if len(values) < FEWEST:
        raise ValueError(f"[columns.base]: {len(values)} rows; the acceleration of a base takes {FEWEST}")
    if time.lost and motion.order < 2:
        raise ValueError(
            f"[columns.base]: {time.missing()}, and a motion cannot be differentiated over a gap; import the parts"
        )
    base = Base(channels["t_s"], values, motion.order)
    channels["ux_mps2"] = base.force_mps2
    given = f"the base's {NAMES[motion.order]}, in {sources['base'].unit},"
    told = f"the drive is {given} as a force per unit mass: less its acceleration"
    for channel in OWN:
        own = sources.get(channel)
        if own is not None and own.frame == "absolute":
            seen = MOTIONS[own.unit]
            channels[channel] = channels[channel] - base.derivative(seen.order) / seen.factor
            told += f"; the base's {NAMES[seen.order]} is taken off what the sensor shows"
    said.append(told)
    return channels


def _in_its_band(record: Prepared, hold: Hold, time: Numbered, mapping: RecordMap, said: list[str]) -> Prepared:
    band = mapping.band(record.rate_Hz)
    assert band is not None  # asked for
    if time.lost:
        raise ValueError(
            f"[filter] needs samples without a gap, but {time.missing()}; import the parts, or leave it out"
        )
    if mapping.steady or not time.uniform:
        raise ValueError("[filter] needs samples that are evenly spaced in time; resample the record, or leave it out")
    drives = [name for name in record.channels if name.startswith(("ux_", "uy_"))]
    if drives and hold == "zoh":
        raise ValueError(
            "[filter] a drive that is held between samples is a staircase, which no filter leaves one; "
            'hold = "bandlimited"'
        )
    passed = {name: name.startswith(("v", "u")) for name in record.channels}
    drop = band.ends_to_drop(len(record.channels["t_s"]))
    channels = band.of(record.channels, passed)
    rows = len(channels["t_s"])

    def moved(row: int) -> int:
        return int(np.clip(-(-(row - drop) // band.decimate), 0, rows))

    segments = {name: (moved(first), moved(stop)) for name, (first, stop) in record.segments.items()}
    if empty := [name for name, (first, stop) in segments.items() if first >= stop]:
        raise ValueError(f"[segments] {empty[0]}: nothing is left of it behind the filter; move it inwards")
    gain = band.noise_gain()
    said.append(_told(mapping, record.rate_Hz, band.rate_after_Hz, drop, gain))
    return Prepared(channels, segments, band.rate_after_Hz, {**record.told, "noise_gain": gain})


def _told(mapping: RecordMap, rate_Hz: float, after_Hz: float, drop: int, gain: float) -> str:
    asked = mapping.filter
    assert asked is not None
    edges = []
    if asked.low_Hz is not None:
        edges.append(f"from {asked.low_Hz:g} Hz")
    if asked.high_Hz is not None:
        edges.append(f"to {asked.high_Hz:g} Hz")
    parts = [f"filtered {' '.join(edges)}, order {asked.order}, forwards and backwards"] if edges else []
    if asked.decimate > 1:
        parts.append(f"every {asked.decimate}th sample kept, {after_Hz:g} Hz of {rate_Hz:g} Hz")
    parts.append(f"{drop / rate_Hz:.3g} s left out at each end")
    parts.append(f"of white noise {gain:.1%} is left: the noise floor is that behind it")
    return "; ".join(parts)


_DEGREE = 7
FEWEST = _DEGREE + 1
"""Rows that a derivative takes at least."""


class Base:
    """Motion of a base at times t_s (n,), given as its `order`-th derivative by time, SI."""

    def __init__(self, t_s: Floats, values: Floats, order: int) -> None:
        self._t_s, self._values, self._order = t_s, values, order
        self._spline: Any = None

    def derivative(self, order: int) -> Floats:
        """The base's displacement (0), velocity (1) or acceleration (2) at its times.

        Raises ValueError where that would be an integral, whose constant nobody knows.
        """
        if order < self._order:
            raise ValueError("it would be an integral")
        if order == self._order:
            return self._values
        if self._spline is None:
            from scipy.interpolate import make_interp_spline  # where it is asked for: it takes a while to load

            middle = self._t_s - self._t_s[0]
            spline = make_interp_spline(middle, self._values, k=_DEGREE)
            self._spline = (spline, middle)
        spline, middle = self._spline
        return np.asarray(spline.derivative(order - self._order)(middle), dtype=float)

    @property
    def force_mps2(self) -> Floats:
        """Force per unit mass on what rides on it, m/s²."""
        return -self.derivative(2)
