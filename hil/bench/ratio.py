"""A number that came out so many times the declared one: the ratio, and the slip of a unit that would give it."""

import math
from collections.abc import Iterable, Mapping
from typing import Protocol

from hil.numbers import significant

NEAR = 0.1
"""How far from a slip's own factor a ratio may be, relative: a model that is so far off finds no ratio exactly, and the
factors lie further apart.
"""
_EXACT = 0.02
_FEW = {
    2.0: "peak to peak for an amplitude",
    math.sqrt(2.0): "an amplitude for an rms value",
}
_SLIPS = {
    2.0 * math.pi: "hertz for rad/s",
    9.80665: "g for m/s²",
    180.0 / math.pi: "degrees for radians",
    1e3: "a thousandth of the unit, as mV for V",
    1e6: "a millionth of the unit, as µm for m",
}


def slip(ratio: float, of_device: Mapping[str, float] | None = None) -> str:
    """What a ratio may come from, with its factor, "" for one that is no known slip; `of_device`: factors that depend
    on it, by what they would be. A slip the other way round has the reciprocal.

    >>> slip(57.3)
    '180/π: degrees for radians, or the reverse'
    """
    size = abs(ratio)
    if not (math.isfinite(size) and size > 0.0):
        return ""
    told = []
    for what, factor in (of_device or {}).items():
        if _is(size, factor, NEAR) and abs(math.log(factor)) > NEAR:  # a mass of a kilogram is no slip
            told.append(what)
    for factor, what in _SLIPS.items():
        if _is(size, factor, NEAR):
            told.append(f"{_written(factor)}: {what}, or the reverse")
    for factor, what in _FEW.items():
        if _is(size, factor, _EXACT):
            told.append(f"{_written(factor)}: {what}, or the reverse")
    return "; or ".join(told)


_GAINS = {"hx", "hy"}
"""Symbols of what is added to the gain of the drive."""


class _Valued(Protocol):
    @property
    def value(self) -> float: ...


def drive_words(blamed: Iterable[tuple[str, Mapping[str, _Valued]]], mass_kg: float) -> tuple[str, ...]:
    """A sentence for each effect, by its name and its coefficients, that is a gain of the drive of both axes."""
    return tuple(
        of_drive((found["hx"].value, found["hy"].value), mass_kg) for _, found in blamed if found.keys() == _GAINS
    )


def of_drive(gains: tuple[float, float], mass_kg: float) -> str:
    """How much of what was declared the two axes' drives do, gains being what is added to 1, and what to check."""
    ratios = [1.0 + gain for gain in gains]
    same = math.isclose(*ratios, rel_tol=NEAR)
    amounts = " and ".join(dict.fromkeys(significant(ratio, 4) for ratio in ratios))
    told = f"the drive acts {amounts} × as declared"
    mass = {f"mass_kg = {mass_kg:g}: newtons for m/s², or the reverse": mass_kg}
    guess = slip(math.sqrt(abs(ratios[0] * ratios[1])), mass) if same else ""
    if guess:
        told += f", near {guess}; check [device.drive] unit, mass_kg and the board's IDENTITY.drive_scale_mps2"
    if same and ratios[0] < 0.0:
        told += ", and the other way round"
    return told


def _is(size: float, factor: float, near: float) -> bool:
    return any(abs(math.log(size / one)) < near for one in (factor, 1.0 / factor))


def _written(factor: float) -> str:
    known = {2.0 * math.pi: "2π", 180.0 / math.pi: "180/π", math.sqrt(2.0): "√2"}
    return known.get(factor, f"{factor:g}")
