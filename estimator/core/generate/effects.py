"""What effects add to force and sense, each with its derivatives: one branch of C for each.

What is clipped is not differentiated by the offset in it: that is of the effect's second order.
"""

from collections.abc import Sequence

import sympy as sp

from estimator.core.generate.printer import assignments, free_symbols, loads, names_in
from estimator.effects.declaration import OF_THE_WAY, Effect, Signal, Source
from estimator.model.declaration import Model

ARGUMENTS = (
    "const real *c, const real *s, const real *u, real *w, whole first, whole signal,\n"
    "    real *value, real *by_states, whole states_row, real *by_constants, whole constants_row"
)
NAMES = names_in(ARGUMENTS)
FORCE, SENSE = "force", "sense"


def _slope(signal: Signal) -> sp.Symbol:
    """Derivative of a direction by the velocity of its axis."""
    return sp.Symbol(f"slope_of_{signal.symbol}")


def _additions(model: Model, effect: Effect, what: str) -> list[tuple[str, sp.Expr]]:
    """Where something is added that is not zero, and what: to the value of an axis, and to its derivatives by states,
    by the effect's own coefficients, by the model's constants, by a signal that depends on the way of that axis.
    """
    states = [state.symbol for state in model.states]
    constants = [constant.symbol for constant in model.constants]
    flowing = [constants.index(constant.symbol) for constant in model.flow_constants]
    found = []
    for axis, expression in enumerate(getattr(effect, what)[: model.axes]):
        by_states, by_constants = (
            f"by_states[{axis} * states_row + {{}}]",
            f"by_constants[{axis} * constants_row + {{}}]",
        )
        found.append((f"value[{axis}]", expression))
        found += [(by_states.format(j), sp.diff(expression, s)) for j, s in enumerate(states)]
        found += [
            (by_constants.format(f"first + {j}"), sp.diff(expression, own.symbol))
            for j, own in enumerate(effect.coefficients)
        ]
        found += [(by_constants.format(j), sp.diff(expression, constants[j])) for j in flowing]
        if what != FORCE:
            continue
        for j, signal in enumerate(effect.signals):
            by_signal = sp.diff(expression, signal.symbol)
            if signal.source is Source.DIRECTION and signal.axis < model.axes:
                found.append((by_states.format(2 * signal.axis + 1), by_signal * _slope(signal)))
            elif signal.source in OF_THE_WAY and signal.axis == axis:
                found.append((f"w[MAX_SIGNALS + signal + {j}]", by_signal))
    return [(place, sp.sympify(e)) for place, e in found if e != 0]


def body(model: Model, effect: Effect, what: str) -> list[str]:
    """Lines that add what an effect does to `what`, none where it does nothing."""
    pairs = _additions(model, effect, what)
    used = free_symbols(e for _, e in pairs)
    places = {constant.symbol: f"c[{i}]" for i, constant in enumerate(model.constants)}
    places |= {state.symbol: f"s[{i}]" for i, state in enumerate(model.states)}
    places |= {symbol: f"u[{i}]" for i, symbol in enumerate(model.inputs)}
    places |= {own.symbol: f"c[first + {i}]" for i, own in enumerate(effect.coefficients)}
    places |= {signal.symbol: f"w[signal + {i}]" for i, signal in enumerate(effect.signals)}
    places |= {_slope(signal): f"w[MAX_SIGNALS + signal + {i}]" for i, signal in enumerate(effect.signals)}
    # By number: a coefficient of a law of one's own may have any name.
    numbered = {symbol: sp.Symbol(f"q{i}") for i, symbol in enumerate(places)}
    renamed = [(place, e.xreplace(numbered)) for place, e in pairs]
    lines = loads({numbered[symbol]: place for symbol, place in places.items()}, {numbered[s] for s in used})
    return lines + [line.replace("] = ", "] += ", 1) if not line.startswith("const") else line
                    for line in assignments(renamed, "t")]  # fmt: skip


def effects_of(model: Model, effects: Sequence[Effect], what: str, numbers: Sequence[int]) -> str:
    """`<model>_effects_<what>`: adds what the effect of that number does."""
    branches = []
    for number in numbers:
        present = effects[number].on(model.axes)
        try:
            lines = [] if present is None else body(model, present, what)
        except NotImplementedError as error:
            raise NotImplementedError(f"[effects.{effects[number].name}] cannot be written as C: {error}") from None
        if lines:
            branches += [f"case {number}: {{ /* {effects[number].name} */", *("    " + line for line in lines)]
            branches += ["    break;", "}"]
    unused = [f"(void){name};" for name in NAMES.split(", ")]
    lines = [" ".join(unused), "switch (effect) {", *branches, "default:", "    break;", "}"]
    head = f"static inline void {model.name}_effects_{what}(whole effect, {ARGUMENTS})\n{{"
    return "\n".join([head, *("    " + line for line in lines), "}"])
