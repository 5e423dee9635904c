"""A number that came out so many times the declared one: the ratio, and the slip of a unit that would give it."""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple, Protocol

import numpy as np

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


class _Valued(Protocol):
    @property
    def value(self) -> float: ...


class Path(NamedTuple):
    """What effects say of the path from the drives to the sense channels, "" where none is of it; whether that is a
    fault of wires or units, which is mended and not declared.
    """

    told: str
    is_fault: bool


def path_of(blamed: Iterable[tuple[str, Mapping[str, _Valued]]], mass_kg: float) -> Path:
    """The path by effects, each by its name and its coefficients: their matrix M (2, 2), times what was declared, and
    the nearest c P, P being a permutation with signs.
    """
    found = {symbol: one.value for _, given in blamed for symbol, one in given.items() if symbol in _OF_PATH}
    hx, hy, mx, my, gy, ex, ey = (found.get(symbol, 0.0) for symbol in _OF_PATH)
    matrix = np.array([[1.0, ex], [ey, 1.0 + gy]]) @ np.array([[1.0 + hx, mx], [my, 1.0 + hy]])
    is_exchange = abs(matrix[0, 1] * matrix[1, 0]) > abs(matrix[0, 0] * matrix[1, 1])
    order = [1, 0] if is_exchange else [0, 1]
    ratios = matrix[[0, 1], order]
    factor, signs = math.sqrt(abs(ratios[0] * ratios[1])), np.sign(ratios)
    is_near = bool(np.max(np.abs(matrix - factor * np.diag(signs)[:, order])) <= NEAR * factor)
    faults = []
    if is_near and is_exchange:
        faults.append(f"x and y are exchanged between drive and sense; exchange the two columns of one {_MEND}")
    if is_near and (turned := [axis for axis, sign in zip("xy", signs, strict=True) if sign < 0.0]):
        acts = f"{' and '.join(turned)} act{'s' if len(turned) == 1 else ''}"
        faults.append(f"{acts} the wrong way round between drive and sense; change the sign of one {_MEND}")
    if faults and float(np.prod(signs)) * (-1.0 if is_exchange else 1.0) < 0.0:
        faults.append("a known rotation tells which of the two: the wrong one reverses the rate")
    mass = {f"mass_kg = {mass_kg:g}: newtons for m/s², or the reverse": mass_kg}
    guess = slip(factor, mass) if is_near else ""
    if guess or (abs(factor - 1.0) > NEAR if faults else "hx" in found):
        same = dict.fromkeys(significant(abs(one) if is_near else one, 4) for one in ratios)
        acts = f"the drive acts {' and '.join(same)} × as declared{' on the other axis' if is_exchange else ''}"
        check = "check [device.drive] unit, mass_kg and the board's IDENTITY.drive_scale_mps2"
        faults.append(f"{acts}, near {guess}; {check}" if guess else acts)
        return Path("; ".join(faults), bool(guess) or len(faults) > 1)
    return Path("; ".join(faults), bool(faults))


_OF_PATH = ("hx", "hy", "mx", "my", "gy", "ex", "ey")
"""Symbols of what is added to the matrices of drive and sense."""
_MEND = "on import, or its wires"


def _is(size: float, factor: float, near: float) -> bool:
    return any(abs(math.log(size / one)) < near for one in (factor, 1.0 / factor))


def _written(factor: float) -> str:
    known = {2.0 * math.pi: "2π", 180.0 / math.pi: "180/π", math.sqrt(2.0): "√2"}
    return known.get(factor, f"{factor:g}")
