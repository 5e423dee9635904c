"""Laws of which a missing force may consist beside what the catalogue has, each written as a bench file would have it.

A law of an axis speaks of q, v, u, the displacement, velocity and drive of the axis itself, and of p, w, those of the
other; it is there on both, each with a coefficient of its own.  A law of the plane is a vector with one coefficient.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import NamedTuple

import numpy as np

from estimator.custom.building import built
from estimator.custom.declaration import PLAUSIBLE, Coefficient, Declaration, Parameter
from estimator.effects.declaration import Effect, si_unit
from estimator.residual.spectrum import lines, periodogram
from estimator.scaling import Array, Scaling
from estimator.trace.problem import Problem


class _Law(NamedTuple):
    """form: how it is written; law: in the grammar of [effects.custom]; metres, seconds: powers of its unit; drives: of
    the drive in it.
    """

    form: str
    law: str
    metres: int
    seconds: int
    drives: int = 1


_OF_AN_AXIS = (
    _Law("|q| q", "abs(q)*q", 2, 0),
    _Law("|q| v", "abs(q)*v", 2, -1),
    _Law("v²", "v**2", 2, -2),
    _Law("q v", "q*v", 2, -1),
    _Law("q v²", "q*v**2", 3, -2),
    _Law("t q", "t*q", 1, 1),
    _Law("t v", "t*v", 1, 0),
)
_DRIVEN = (_Law("u³", "u**3", 3, -6, 3), _Law("|u| u", "abs(u)*u", 2, -4, 2), _Law("q u", "q*u", 2, -2))
_CROSSED = (
    _Law("p²", "p**2", 2, 0),
    _Law("q p", "q*p", 2, 0),
    _Law("q² p", "q**2*p", 3, 0),
    _Law("p³", "p**3", 3, 0),
    _Law("q p²", "q*p**2", 3, 0),
    _Law("p² v", "p**2*v", 3, -1),
    _Law("w² q", "w**2*q", 3, -2),
)
_BEYOND = _Law("q beyond ±g", "q - 0.5*(abs(q + g) - abs(q - g))", 1, 0)
_GAPS = (0.2, 0.4, 0.6, 0.8)
"""Shares of the largest displacement at which a search for a gap begins."""
_DECAYING = _Law("exp(-k t)", "exp(-k*t)", 0, 0)
_LASTING = (1.0, 0.1)
"""Shares of the record over which an offset that dies away does, where a search for it begins."""
_OF_THE_PLANE = (
    (_Law("|r| r", "", 2, 0), ("r*x", "r*y")),
    (_Law("|r| v", "", 2, -1), ("r*vx", "r*vy")),
    (_Law("|v|² r", "", 3, -2), ("v**2*x", "v**2*y")),
    (_Law("(r·v) r", "", 3, -1), ("(x*vx + y*vy)*x", "(x*vx + y*vy)*y")),
    (_Law("(r·v) v", "", 3, -2), ("(x*vx + y*vy)*vx", "(x*vx + y*vy)*vy")),
    (_Law("r² J v", "", 3, -1), ("r**2*vy", "-r**2*vx")),
    (_Law("r² J r", "", 3, 0), ("r**2*y", "-r**2*x")),
    (_Law("∇(x² y)", "", 2, 0), ("2*x*y", "x**2")),
    (_Law("∇(x y²)", "", 2, 0), ("y**2", "2*x*y")),
    (_Law("∇(x³ y)", "", 3, 0), ("3*x**2*y", "x**3")),
    (_Law("∇(x² y²)", "", 3, 0), ("2*x*y**2", "2*x**2*y")),
    (_Law("∇(x y³)", "", 3, 0), ("y**3", "3*x*y**2")),
)
_NAMES = {"q": "x y", "v": "vx vy", "u": "ux uy", "p": "y x", "w": "vy vx"}
_CLEAR = 1e-3
"""Chance that noise shows a line from which a change of stiffness is looked for."""


@dataclass(frozen=True)
class Term:
    """A law of the library: its form, what one of each coefficient adds along x and y, by label, and the effect that
    observers carry.
    """

    form: str
    laws: Mapping[str, tuple[str, str]]
    effect: Effect


def library(problem: Problem, residual: Array) -> tuple[Term, ...]:
    """All laws for a record; residual (n, axes): the innovation of the model without any, V."""
    device, record = problem.device, problem.record
    scaling, axes, numbers = Scaling.of(device), device.axes, count(1)
    sense = np.abs(record.sense - np.nanmean(record.sense, axis=0)) / np.abs(device.sense_gain)
    reach, force = float(np.nanmax(sense)), float(np.max(np.abs(record.drive[:, :, 0]), initial=0.0)) / scaling.drive

    def term(
        law: _Law, laws: Mapping[str, tuple[str, str]], inside: Mapping[str, Parameter] | None = None, *,
        sensed: bool = False,
    ) -> Term:  # fmt: skip
        length, time = 1 - law.metres, -law.seconds - (0 if sensed else 2)
        # What is driven near its resonance is driven by far less than the spring's force.
        size = PLAUSIBLE / max(force, 1e-9) ** (law.drives - 1) * scaling.length**length * scaling.omega0**-time
        names = {label: "c_" + label.replace(" ", "_") for label in laws}
        along = [
            " + ".join(f"{names[label]}*({one[axis]})" for label, one in laws.items() if one[axis])
            for axis in range(axes)
        ]
        pair = (along[0], along[1] if axes == 2 else "")
        declared = Declaration(
            name=f"form_{next(numbers)}", title=law.form, force=("", "") if sensed else pair,
            sense=pair if sensed else ("", ""), parameters=dict(inside or {}),
            coefficients={name: Coefficient(si_unit(length, time), plausible=size) for name in names.values()},
        )  # fmt: skip
        return Term(law.form, laws, built(declared, scaling, axes))

    def on_axes(law: str) -> dict[str, tuple[str, str]]:
        own = _of_each_axis(law)
        return {"x": (own[0], ""), "y": ("", own[1])} if axes == 2 else {"x": (own[0], "")}

    laws = [*_OF_AN_AXIS, *(_DRIVEN if force > 0.0 else ()), *(_CROSSED if axes == 2 else ())]
    terms = [term(law, on_axes(law.law)) for law in laws]
    gaps = tuple(share * reach for share in _GAPS)
    terms.append(term(_BEYOND, on_axes(_BEYOND.law), {"g": Parameter("m", gaps[1], gaps)}))
    decays = tuple(1.0 / (share * problem.span) for share in _LASTING)
    terms.append(term(_DECAYING, on_axes(_DECAYING.law), {"k": Parameter("1/s", decays[0], decays)}, sensed=True))
    terms.append(term(_Law("t", "t", 0, 1), on_axes("t"), sensed=True))
    if axes == 2:
        terms += [term(law, {"both": pair}) for law, pair in _OF_THE_PLANE]
    if found := tuple(_modulations(problem, residual)):
        both = {f"{wave} both": (f"x*{wave}(w*t)", f"y*{wave}(w*t)" if axes == 2 else "") for wave in ("cos", "sin")}
        law = _Law("q cos(w t), q sin(w t)", "", 1, 0)
        terms.append(term(law, both, {"w": Parameter("1/s", found[0], found)}))
    return tuple(terms)


def _of_each_axis(law: str) -> list[str]:
    for letter in _NAMES:
        law = re.sub(rf"\b{letter}\b", f"{{{letter}}}", law)
    return [law.format(**{letter: names.split()[axis] for letter, names in _NAMES.items()}) for axis in range(2)]


def _modulations(problem: Problem, residual: Array) -> Iterator[float]:
    """Frequencies, rad/s, at which the stiffness may change: by how much lines of the residual are beside the
    resonance.
    """
    rate_Hz = 1.0 / float(np.mean(problem.record.step))
    resonance_Hz = float(np.sqrt(problem.device.target)) / (2.0 * np.pi)
    there = residual[np.any(np.isfinite(residual), axis=1)]
    seen: list[float] = []
    for line in lines(periodogram(there, rate_Hz, resonance_Hz), rate_Hz, resonance_Hz, _CLEAR) if len(there) else ():
        beside = 2.0 * np.pi * abs(line.offset)
        if line.order == 1 and beside * problem.span > 4.0 * np.pi and _is_new(beside, seen, problem.span):
            seen.append(beside)
            yield beside
        if len(seen) == 3:
            return


def _is_new(omega: float, seen: Sequence[float], span: float) -> bool:
    return all(abs(omega - other) * span > 2.0 * np.pi for other in seen)
