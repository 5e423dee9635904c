"""A set of effects in C, from their declarations: what the step in C is built with."""

from collections.abc import Iterable, Sequence
from typing import Any

import sympy as sp

from estimator.effects.declaration import Effect
from estimator.kernel.drifts import DRIFTS, KICKS
from estimator.model.declaration import Model


def in_c(model: Model, effects: Sequence[Effect]) -> str:
    """A header: E coefficients, the splitting, and `push`, the forces (2,) with their derivatives by states (2, 4) and
    coefficients (2, E); where an effect is of the measurement, SENSED and `sensed`, what it adds to the measurement,
    likewise.

    Raises ValueError for effects that are late or depend on a signal.
    """
    for effect in effects:
        if effect.signals or effect.delayed is not None:
            raise ValueError(f"{effect.name} is not of state and drive alone")
    coefficients = [coefficient.symbol for effect in effects for coefficient in effect.coefficients]
    lines = ["#include <math.h>", f"#define E {len(coefficients)}"]
    for name, values in (("DRIFTS", DRIFTS), ("KICKS", KICKS)):
        lines.append(f"static const double {name}[{len(values)}] = {{{', '.join(repr(value) for value in values)}}};")
    lines += _function(
        "push", model, coefficients, [_sum(effect.force[axis] for effect in effects) for axis in range(2)]
    )
    if any(any(effect.sense) for effect in effects):
        adds = [_sum(effect.sense[axis] for effect in effects) for axis in range(2)]
        lines += ["#define SENSED", *_function("sensed", model, coefficients, adds)]
    return "\n".join(lines) + "\n"


def _sum(terms: Iterable[Any]) -> sp.Expr:
    return sum((sp.sympify(term) for term in terms), sp.Integer(0))


def _function(name: str, model: Model, coefficients: Sequence[sp.Symbol], found: Sequence[sp.Expr]) -> list[str]:
    """Two expressions and their derivatives as a function of the constants c, the states s and the drive u."""
    states = [state.symbol for state in model.states]
    pairs = [(f"f[{a}]", found[a]) for a in range(2)]
    pairs += [(f"by[{a}][{j}]", sp.diff(found[a], s)) for a in range(2) for j, s in enumerate(states)]
    pairs += [(f"own[{a}][{j}]", sp.diff(found[a], c)) for a in range(2) for j, c in enumerate(coefficients)]
    shared, reduced = sp.cse([expression for _, expression in pairs], symbols=sp.numbered_symbols("w"))
    lines = [
        f"static void {name}(const double *c, const double *s, const double *u, double f[2], double by[2][4], "
        "double own[2][E])\n{"
    ]
    lines += [f"    double {s} = s[{i}];" for i, s in enumerate(states)]
    lines += [f"    double {s} = u[{i}];" for i, s in enumerate(model.inputs)]
    lines += [f"    double {s} = c[{i}];" for i, s in enumerate(constant.symbol for constant in model.constants)]
    lines += [f"    double {s} = c[{len(model.constants) + i}];" for i, s in enumerate(coefficients)]
    known = [*states, *model.inputs, *(constant.symbol for constant in model.constants), *coefficients]
    lines += [f"    (void){s};" for s in known]
    lines += [f"    double {symbol} = {sp.ccode(expression)};" for symbol, expression in shared]
    lines += [f"    {place} = {sp.ccode(expression)};" for (place, _), expression in zip(pairs, reduced, strict=True)]
    return [*lines, "}"]
