"""The forces of a set of effects in C, from their declarations: what the step in C is built with."""

from collections.abc import Sequence

import sympy as sp

from estimator.effects.declaration import Effect
from estimator.kernel.flow import DRIFTS, KICKS
from estimator.model.declaration import Model


def in_c(model: Model, effects: Sequence[Effect]) -> str:
    """A header: E coefficients, the splitting, and `push`, the forces (2,) with their derivatives by states (2, 4) and
    coefficients (2, E), of effects that are forces alone and depend on no signal.

    Raises ValueError for any other.
    """
    for effect in effects:
        if effect.signals or effect.delayed is not None or any(effect.sense):
            raise ValueError(f"{effect.name} is not a force of state and drive alone")
    states = [state.symbol for state in model.states]
    coefficients = [coefficient.symbol for effect in effects for coefficient in effect.coefficients]
    force = [sum((sp.sympify(effect.force[axis]) for effect in effects), sp.Integer(0)) for axis in range(2)]
    pairs = [(f"f[{a}]", force[a]) for a in range(2)]
    pairs += [(f"by[{a}][{j}]", sp.diff(force[a], s)) for a in range(2) for j, s in enumerate(states)]
    pairs += [(f"own[{a}][{j}]", sp.diff(force[a], c)) for a in range(2) for j, c in enumerate(coefficients)]
    shared, reduced = sp.cse([expression for _, expression in pairs], symbols=sp.numbered_symbols("w"))
    lines = ["#include <math.h>", f"#define E {len(coefficients)}"]
    for name, values in (("DRIFTS", DRIFTS), ("KICKS", KICKS)):
        lines.append(f"static const double {name}[{len(values)}] = {{{', '.join(repr(value) for value in values)}}};")
    lines.append(
        "static void push(const double *c, const double *s, const double *u, double f[2], double by[2][4], "
        "double own[2][E])\n{"
    )
    lines += [f"    double {s} = s[{i}];" for i, s in enumerate(states)]
    lines += [f"    double {s} = u[{i}];" for i, s in enumerate(model.inputs)]
    lines += [f"    double {s} = c[{i}];" for i, s in enumerate(constant.symbol for constant in model.constants)]
    lines += [f"    double {s} = c[{len(model.constants) + i}];" for i, s in enumerate(coefficients)]
    known = [*states, *model.inputs, *(constant.symbol for constant in model.constants)]
    lines += [f"    (void){s};" for s in known]
    lines += [f"    double {symbol} = {sp.ccode(expression)};" for symbol, expression in shared]
    lines += [f"    {name} = {sp.ccode(expression)};" for (name, _), expression in zip(pairs, reduced, strict=True)]
    return "\n".join([*lines, "}"]) + "\n"
