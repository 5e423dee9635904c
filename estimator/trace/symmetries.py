"""Causes that no record can tell from what was named, since the equations are the same in other words.

With V = S x the voltages of a plane gyro follow

    ẍ = G u − D ẋ − K x + 2 Ω C ẋ + Ω̇ C x − Ω² C² x,    C = [[0, 1], [−1, 0]]

Three changes leave every voltage as it is: other coordinates, x = A x' (S → S A, and A⁻¹ · A of K, D and C, A⁻¹ G);
another unit of time, t = a t' (K → a² K, G → a² G, D → a D, C → a C); all paths late together.  Time that runs
backwards turns the signs of D and C.  Each equivalent below is one of these, and has one measurement that no voltage of
such a record replaces (docs/explanation.md).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.diagnosis import Interval
from estimator.thresholds import THRESHOLDS
from estimator.trace.search import FORBIDDEN

_SET = THRESHOLDS.symmetries

Intervals = Mapping[str, Mapping[str, Interval]]
"""By effect, by coefficient."""

REFERENCE_CLOCK = "compare the sampling clock with a reference clock"
KNOWN_WEIGHT = "weigh the proof mass"
KNOWN_MOTION = "move the proof mass by a known distance"
GRAVITY_SIGN = "tilt that axis: gravity tells the sign of its sense"
GRAVITY_FRAME = "tilt it about a known axis: gravity tells the frame of its sense"
GRAVITY_SIZE = "tilt each axis by the same angle: gravity is in proportion to its mass"
VARYING_RATE = "turn the gyro at a varying rate"
RING_DOWN = "switch the drive off: a ring-down decays"
TIMED_RATE = "turn the gyro at a rate that is known in time"


@dataclass(frozen=True)
class Constants:
    """What a trace found of the base model, SI, in the order xx, yy, xy; declared: the stiffness of the bench file with
    its standard deviation, 1/s².
    """

    stiffness: Sequence[float]
    damping: Sequence[float]
    declared: tuple[float, ...]
    spread: float


@dataclass(frozen=True)
class Equivalent:
    """`other` in place of `effect`, with the size it then has; the measurement that tells which; how the bench file
    declares it, "" where nothing does; how far in rad the angle moves, None where nothing is known of that.
    """

    effect: str
    other: str
    size: float
    separate_by: str
    declare: str
    angle: float | None

    @property
    def told_by(self) -> str:
        """The measurement, and what to write into the bench file once it has spoken for `other`."""
        return f"{self.separate_by}; if so, declare {self.declare}" if self.declare else self.separate_by


def equivalents(named: Intervals, constants: Constants, nonreciprocal: Interval | None) -> tuple[Equivalent, ...]:
    """All that `named` may be as well; nonreciprocal: what the record says of such a stiffness, named or not."""
    coupling = constants.stiffness[2]
    found = [
        *_of_drive_gain(named, constants),
        *_of_polarity(named),
        *_of_frames(named),
        *_of_masses(named),
        *_of_one_axis(named, coupling, nonreciprocal),
        *_of_delays(named),
    ]
    dxx, dyy, dxy = constants.damping
    if named and dxx + dyy < 0.0 and dxx * dyy > dxy**2:
        found.append(Equivalent(next(iter(named)), "time_reversal", -1.0, RING_DOWN, "", None))
    return tuple(found)


def nonreciprocal_of(found: Intervals) -> Interval | None:
    """What a record says of a stiffness that acts one way, of what it says of each effect."""
    return found.get("nonreciprocal_stiffness", {}).get("kn")


def _of_drive_gain(named: Intervals, constants: Constants) -> Iterator[Equivalent]:
    """A drive gain common to both axes: scale of time, of mass, of sense."""
    if "drive_gain" not in named or not _same(named["drive_gain"]["hx"], named["drive_gain"]["hy"]):
        return
    gain = 1.0 + _mean(named["drive_gain"])
    if any(given.low <= -1.0 for given in named["drive_gain"].values()):
        return
    apart = [constants.stiffness[i] / gain - constants.declared[i] for i in range(2)]
    if all(abs(off) < FORBIDDEN * constants.spread for off in apart):
        slow = float(np.sqrt(gain)) - 1.0
        yield Equivalent("drive_gain", "clock_rate", slow, REFERENCE_CLOCK, _effect("clock_rate", delta=slow), 0.0)
    heavier = f"[device] mass_kg times {1.0 / gain:.6g} where the drive is a force, else the drive_gain"
    yield Equivalent("drive_gain", "mass_scale", 1.0 / gain - 1.0, KNOWN_WEIGHT, heavier, 0.0)
    larger = f"[device.sense] gain_V_per_m times {gain:.6g}"
    yield Equivalent("drive_gain", "sense_scale", gain - 1.0, KNOWN_MOTION, larger, 0.0)


def _of_polarity(named: Intervals) -> Iterator[Equivalent]:
    """An axis that is driven or sensed with the wrong sign: the other of the two, with coupling and rate turned."""
    for effect, symbols in (("drive_gain", ("hx", "hy")), ("sense_gain", ("", "gy"))):
        given = named.get(effect, {})
        flipped = [symbol in given and given[symbol].high < -1.0 for symbol in symbols]
        if not any(flipped):
            continue
        own, other = ("drive", "sense") if effect == "drive_gain" else ("sense", "drive")
        angle = 0.0 if all(flipped) else None
        turned = {symbol: 1.0 for symbol, is_turned in zip(("px", "py"), flipped, strict=True) if is_turned}
        own, other = f"{own}_polarity", f"{other}_polarity"
        yield Equivalent(effect, own, -2.0, GRAVITY_SIGN, _effect(own, **turned), 0.0)
        yield Equivalent(effect, other, -2.0, GRAVITY_SIGN, _effect(other, **turned), angle)


def _of_frames(named: Intervals) -> Iterator[Equivalent]:
    """A drive that is turned against the sense: either may be the one that is."""
    pairs = (("drive_misalignment", ("mx", "my")), ("sense_cross_coupling", ("ex", "ey")))
    for (effect, symbols), (other, others) in (pairs, pairs[::-1]):
        if effect not in named or not _opposite(*(named[effect][symbol] for symbol in symbols)):
            continue
        tangent = 0.5 * (named[effect][symbols[0]].value - named[effect][symbols[1]].value)
        declare = _effect(other, **dict(zip(others, (tangent, -tangent), strict=True)))
        yield Equivalent(effect, other, tangent, GRAVITY_FRAME, declare, abs(float(np.arctan(tangent))))


def _of_masses(named: Intervals) -> Iterator[Equivalent]:
    """Another mass on one axis: the gains of its drive and its sense by the same share, the rate by that share."""
    drive, sense = named.get("drive_gain"), named.get("sense_gain")
    if drive and sense and _nothing(drive["hx"], drive["hy"]) and _same(drive["hy"], sense["gy"]):
        mass = (1.0 + sense["gy"].value) ** -2
        declare = _effect("unequal_masses", m=mass - 1.0)
        yield Equivalent("sense_gain", "unequal_masses", mass - 1.0, GRAVITY_SIZE, declare, None)


def _of_one_axis(named: Intervals, coupling: float, nonreciprocal: Interval | None) -> Iterator[Equivalent]:
    """A drive gain of one axis alone, with a stiffness that is not symmetric as large as kxy makes it: in coordinates
    that are not scaled, the mass of that axis; in scaled ones, its sense gain (and a Coriolis force that is not
    antisymmetric: exact but for 2 Ω times the share).
    """
    drive = named.get("drive_gain")
    if drive is None or "sense_gain" in named or nonreciprocal is None:
        return
    for axis, (own, beside) in enumerate((("hx", "hy"), ("hy", "hx"))):
        gain, side = 1.0 + drive[own].value, -1.0 if axis == 0 else 1.0
        if not _nothing(drive[beside], drive[own]) or gain <= 0.0:
            continue
        if _shows(nonreciprocal, side * coupling * (1.0 - gain) / (1.0 + gain)):
            # The effect counts masses and forces by the mass of x; effects add up.
            declare = _effect("unequal_masses", m=(1.0 / gain if axis == 1 else gain) - 1.0)
            if axis == 0:
                declare += " and " + _effect("drive_gain", hx=gain - 1.0, hy=1.0 - 1.0 / gain)
            yield Equivalent("drive_gain", "unequal_masses", 1.0 / gain - 1.0, VARYING_RATE, declare, None)
        if _shows(nonreciprocal, side * coupling * (1.0 - gain**2) / (1.0 + gain**2)):
            declare = _effect("sense_gain", gy=gain - 1.0) if axis == 1 else ""
            yield Equivalent("drive_gain", "sense_gain", gain - 1.0, VARYING_RATE, declare, None)


def _shows(found: Interval, expected: float) -> bool:
    """Whether a coefficient may be what is expected."""
    return found.low <= expected <= found.high or _near(found.value, expected)


def _of_delays(named: Intervals) -> Iterator[Equivalent]:
    """Both channels late by as much: of the sense or of the drive, with the rate as late."""
    pairs = (("sense_delay", ("tsx", "tsy")), ("drive_delay", ("tux", "tuy")))
    for (effect, symbols), (other, others) in (pairs, pairs[::-1]):
        if effect in named and _same(*(named[effect][symbol] for symbol in symbols)):
            late = _mean(named[effect])
            declare = _effect(other, **dict.fromkeys(others, late))
            yield Equivalent(effect, other, late, TIMED_RATE, declare, None)


def _effect(name: str, **coefficients: float) -> str:
    """As the bench file has it."""
    return f"[effects.{name}] " + ", ".join(f"{symbol} = {value:.6g}" for symbol, value in coefficients.items())


def _mean(given: Mapping[str, Interval]) -> float:
    return float(np.mean([interval.value for interval in given.values()]))


def _same(one: Interval, other: Interval) -> bool:
    """Whether two coefficients may be one and the same."""
    halves = float(np.hypot(one.high - one.value, other.high - other.value))
    return abs(one.value - other.value) <= halves or _near(one.value, other.value)


def _opposite(one: Interval, other: Interval) -> bool:
    return _same(one, Interval(-other.value, -other.high, -other.low, other.unit))


def _nothing(one: Interval, beside: Interval) -> bool:
    """Whether a coefficient may be zero, or is small beside the other, which is not."""
    is_something = beside.low > 0.0 or beside.high < 0.0
    return is_something and (one.low <= 0.0 <= one.high or abs(one.value) <= _SET.broken * abs(beside.value))


def _near(one: float, other: float) -> bool:
    return abs(one - other) <= _SET.broken * max(abs(one), abs(other))
