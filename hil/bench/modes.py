"""Stiffness and damping as a resonator is measured: frequencies, quality factors and the directions of its axes.

A two-axis device has two principal axes of stiffness, at right angles, on which it resonates at two frequencies, and
two of damping. The matrix [xx, yy, xy] of either is what these give in the axes x and y (Lynch, "Vibratory gyro
analysis by the method of averaging", 1995).
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from pydantic import ValidationError

from hil.bench.section import Numbers, Positive, Section


class Principal(NamedTuple):
    """A symmetric matrix by its principal values, the larger first, and the angle of its axis from x, -π/2 to π/2."""

    larger: float
    smaller: float
    azimuth_rad: float


def principal(entries: tuple[float, ...]) -> Principal:
    """Of [xx, yy, xy]; of [xx] alone the value twice.

    >>> principal((3.0, 1.0, 0.0)), principal((2.0, 2.0, 1.0)).larger
    (Principal(larger=3.0, smaller=1.0, azimuth_rad=0.0), 3.0)
    """
    if len(entries) == 1:
        return Principal(entries[0], entries[0], 0.0)
    xx, yy, xy = entries
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    return Principal(mean + half, mean - half, 0.5 * math.atan2(2.0 * xy, xx - yy))


def matrix(first: float, second: float, azimuth_rad: float) -> tuple[float, float, float]:
    """[xx, yy, xy] of the value `first` along the azimuth and `second` across it."""
    mean, half = 0.5 * (first + second), 0.5 * (first - second)
    turn = 2.0 * azimuth_rad
    return mean + half * math.cos(turn), mean - half * math.cos(turn), half * math.sin(turn)


def frequencies_Hz(stiffness_per_s2: tuple[float, ...]) -> tuple[float, float]:
    """The two resonances of a stiffness over the mass, the higher first; 0 where nothing pulls back."""
    found = principal(stiffness_per_s2)
    higher, lower = (math.sqrt(max(one, 0.0)) / math.tau for one in (found.larger, found.smaller))
    return higher, lower


class Modes(Section):
    """The keys that stand in [device] for stiffness and damping."""

    resonance_Hz: Positive | None = None
    """instead of stiffness_N_per_m: mean of the two resonances"""
    split_Hz: float | None = None
    """beside resonance_Hz: one resonance less the other, negative where the first is the lower; without it 0"""
    azimuth_deg: float | None = None
    """beside split_Hz: direction from x of the axis that has the first resonance; without it 0"""
    q: Numbers | None = None
    """instead of damping_N_s_per_m: quality factor Q = π f τ at the mean resonance f; one number, or one for each
    principal axis of damping (axes = 2)"""
    decay_time_s: Numbers | None = None
    """instead of damping_N_s_per_m: time τ in which the amplitude falls to 1/e, τ = Q/(π f); one number, or one for
    each principal axis of damping (axes = 2)"""
    damping_azimuth_deg: float | None = None
    """beside two numbers in q or decay_time_s: direction from x of the axis of the first; without it 0"""


STIFFNESS, DAMPING = "stiffness_N_per_m", "damping_N_s_per_m"
STANDS_FOR = {
    STIFFNESS: ("resonance_Hz", "split_Hz", "azimuth_deg"),
    DAMPING: ("q", "decay_time_s", "damping_azimuth_deg"),
}
"""Which keys of `Modes` stand for a key of [device]."""
STANDS_BESIDE = ("split_Hz", "azimuth_deg", "damping_azimuth_deg")
"""Those that say more of another and stand for nothing alone."""


def in_stiffness_and_damping(table: Mapping[str, Any]) -> dict[str, Any]:
    """[device] with stiffness and damping in place of the keys of `Modes`.

    Raises ValueError that names the keys: one quantity given in two ways, a key without the one that it stands beside.
    """
    names = [name for name in Modes.model_fields if name in table]
    plain = {key: value for key, value in table.items() if key not in names}
    if not names:
        return plain
    for key, others in STANDS_FOR.items():
        ways = [name for name in (key, *others) if name in table and name not in STANDS_BESIDE]
        if len(ways) > 1:
            raise ValueError(f"{', '.join(ways)}: one quantity given in two ways; give one of them")
    modes = _checked({name: table[name] for name in names})
    axes, mass = table.get("axes", 2), table.get("mass_kg")
    if isinstance(mass, bool) or not isinstance(mass, int | float) or not 0 < mass < math.inf or axes not in (1, 2):
        return plain  # what is wrong with it is told of the key itself
    _require_partners(modes, table, axes)
    if modes.resonance_Hz is not None:
        plain[STIFFNESS] = _stiffness(modes, float(mass), axes)
    if modes.q is not None or modes.decay_time_s is not None:
        plain[DAMPING] = _damping(modes, float(mass), axes, plain.get(STIFFNESS))
    return plain


def _checked(table: Mapping[str, Any]) -> Modes:
    try:
        return Modes.model_validate(table)
    except ValidationError as error:
        from hil.toml.reading import one_line

        raise ValueError(one_line(error, Modes).replace("[", "", 1).replace("]", "", 1)) from None


def _require_partners(modes: Modes, table: Mapping[str, Any], axes: int) -> None:
    losses = modes.q or modes.decay_time_s or ()
    for name, beside, there in (
        ("split_Hz", "resonance_Hz", modes.resonance_Hz is not None),
        ("azimuth_deg", "split_Hz", modes.split_Hz is not None),
        ("damping_azimuth_deg", "two numbers in q or decay_time_s", len(losses) == 2),
    ):
        if name in table and not there:
            raise ValueError(f"{name}: stands beside {beside}; give that too, or leave it out")
        if name in table and axes == 1:
            raise ValueError(f"{name}: a single axis has none; leave it out")
    if modes.split_Hz is not None and modes.resonance_Hz is not None and abs(modes.split_Hz) >= 2 * modes.resonance_Hz:
        raise ValueError(f"split_Hz: {modes.split_Hz:g} leaves no lower resonance below {modes.resonance_Hz:g} Hz")
    for name, values in (("q", modes.q), ("decay_time_s", modes.decay_time_s)):
        if values is not None and (len(values) > axes or not values):
            raise ValueError(f"{name}: expected one number{' or two' if axes == 2 else ''}, not {len(values)}")
        if values is not None and min(values) <= 0:
            raise ValueError(f"{name}: {min(values):g} should be greater than 0; no damping is damping_N_s_per_m")


def _stiffness(modes: Modes, mass: float, axes: int) -> list[float]:
    mean, apart = modes.resonance_Hz or 0.0, modes.split_Hz or 0.0
    first, second = (mass * (math.tau * (mean + half)) ** 2 for half in (0.5 * apart, -0.5 * apart))
    return [first] if axes == 1 else list(matrix(first, second, math.radians(modes.azimuth_deg or 0.0)))


def _damping(modes: Modes, mass: float, axes: int, stiffness: Any) -> list[float]:
    """Force per velocity: m ω/Q at the mean resonance, 2 m/τ."""
    if modes.decay_time_s is not None:
        along = [2.0 * mass / tau for tau in modes.decay_time_s]
    else:
        omega = math.pi * sum(frequencies_Hz(_per_mass(stiffness, mass, axes)))
        if omega == 0.0 and stiffness is not None:
            raise ValueError("q: without a resonance there is none; give resonance_Hz, or damping_N_s_per_m")
        along = [mass * omega / q for q in modes.q or ()]
    if axes == 1:
        return along
    return list(matrix(along[0], along[-1], math.radians(modes.damping_azimuth_deg or 0.0)))


def _per_mass(stiffness: Any, mass: float, axes: int) -> tuple[float, ...]:
    """What [device] declares over its mass; zeros where that is no stiffness, which is told of its own key."""
    values = stiffness if isinstance(stiffness, list | tuple) else [stiffness]
    wanted = 3 if axes == 2 else 1
    if len(values) != wanted or not all(isinstance(one, int | float) and not isinstance(one, bool) for one in values):
        return (0.0,) * wanted
    return tuple(one / mass for one in values)
