"""From declarations to the source of one Numba module: the vector field on Taylor columns, the measurement, the jumps.

A step of the flow is a Taylor series: with ṡ = M(c) s + N(c) u the coefficients follow a_{n+1} = (M a_n + N u_n) / (n
+ 1), and the sensitivities to initial state and constants obey the same recursion with ∂M/∂c a_n + ∂N/∂c u_n added.
So one generated function serves values and Jacobian alike, on an array whose columns are [state | ∂/∂s0 | ∂/∂flow
constants].
"""

from collections.abc import Iterable, Mapping, Sequence

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from estimator.effects.declaration import OF_THE_WAY, Effect, Signal, Source
from estimator.kernel.layout import MAX_SIGNALS
from estimator.kernel.pointer import FORCE, SENSE
from estimator.model.declaration import Model

PRINTER = PythonCodePrinter({"fully_qualified_modules": True})

_HEADER = '''"""Generated from the model declarations; not to be edited."""

import math

from estimator.kernel.compiled import branching, compiled, inlined
from estimator.kernel.lanes import gather, lane, put, put_columns, take
from estimator.kernel.pointer import LEAST_ADDRESS, call_force, call_sense


'''


def assignments(pairs: Iterable[tuple[str, sp.Expr]], prefix: str, indent: str) -> list[str]:
    """Lines that compute the expressions, common subexpressions first."""
    named = list(pairs)
    shared, reduced = sp.cse([expr for _, expr in named], symbols=sp.numbered_symbols(prefix))
    lines = [f"{indent}{symbol} = {PRINTER.doprint(expr)}" for symbol, expr in shared]
    lines += [f"{indent}{name} = {PRINTER.doprint(expr)}" for (name, _), expr in zip(named, reduced, strict=True)]
    return lines


def _unpack(symbols: Sequence[sp.Symbol], source: str, used: set[sp.Basic]) -> list[str]:
    return [f"    {s} = {source.format(i=i)}" for i, s in enumerate(symbols) if s in used]


def free_symbols(expressions: Iterable[sp.Expr]) -> set[sp.Basic]:
    return set().union(*(sp.sympify(e).free_symbols for e in expressions))


def _field_columns(model: Model) -> str:
    """`<model>_field_columns(c, a, u, out, columns)`: out = M a, plus the forcing of the state and constant columns."""
    m, n = model.system_matrices()
    states = [state.symbol for state in model.states]
    constants = [constant.symbol for constant in model.constants]
    nonzero = [(i, j, m[i, j]) for i in range(m.rows) for j in range(m.cols) if m[i, j] != 0]
    trivial = {(i, j): e for i, j, e in nonzero if e.is_number}
    entries = [(f"m{i}_{j}", e) for i, j, e in nonzero if not e.is_number]
    input_terms = [sum((n[i, j] * model.inputs[j] for j in range(n.cols)), sp.Integer(0)) for i in range(n.rows)]
    forcing = [
        (i, 1 + len(states) + j, sp.diff(model.field[i], constant.symbol))
        for j, constant in enumerate(model.flow_constants)
        for i in range(m.rows)
    ]
    forcing = [(i, column, expr) for i, column, expr in forcing if expr != 0]

    lines = ["@compiled", f"def {model.name}_field_columns(c, a, u, out, columns):"]
    lines += _unpack(
        constants,
        "c[{i}]",
        free_symbols(e for _, e in entries) | free_symbols(input_terms) | free_symbols(f[2] for f in forcing),
    )
    lines += _unpack(model.inputs, "u[{i}]", free_symbols(input_terms) | free_symbols(f[2] for f in forcing))
    lines += assignments(entries, "w", "    ")
    lines.append("    for j in range(columns):")
    for i in range(m.rows):
        terms = []
        for r, col, expr in nonzero:
            if r == i:
                weight = "" if trivial.get((r, col)) == 1 else f"m{r}_{col} * "
                if (r, col) in trivial and weight:
                    weight = f"{PRINTER.doprint(expr)} * "
                terms.append(f"{weight}a[{col}, j]")
        lines.append(f"        out[{i}, j] = {' + '.join(terms) if terms else '0.0'}")
    lines += [f"    out[{i}, 0] += {PRINTER.doprint(e)}" for i, e in enumerate(input_terms) if e != 0]
    lines.append("    if columns > 1:")
    lines += ["    " + line for line in _unpack(states, "a[{i}, 0]", free_symbols(f[2] for f in forcing))]
    lines += assignments([(f"f{i}_{c}", e) for i, c, e in forcing], "v", "        ")
    lines += [f"        out[{i}, {c}] += f{i}_{c}" for i, c, _ in forcing]
    return "\n".join(lines)


def _taylor(model: Model) -> str:
    """`<model>_taylor(c, u, h, order, columns, a, out)`: advance the columns of out by their Taylor series over h.

    u (axes, degree + 1) is the drive in normalised time, a scratch of out's shape; columns is 1 or all.  Where those of
    the base model fill vector registers they are lanes.  Elsewhere the columns are taken four at a time, everything
    read before anything is written: so the compiler puts them side by side into such registers.
    """
    m, n = model.system_matrices()
    rows = range(m.rows)
    states = [state.symbol for state in model.states]
    constants = [constant.symbol for constant in model.constants]
    input_terms = [sum((n[i, j] * model.inputs[j] for j in range(n.cols)), sp.Integer(0)) for i in rows]
    forcing = {
        (i, 1 + len(states) + j): expr
        for j, constant in enumerate(model.flow_constants)
        for i in rows
        if (expr := sp.diff(model.field[i], constant.symbol)) != 0
    } | {(i, 0): expr for i, expr in enumerate(input_terms) if expr != 0}
    varying = [(f"m{i}_{j}", m[i, j]) for i in rows for j in range(m.cols) if not m[i, j].is_number]
    base = 1 + len(states) + len(model.flow_constants)

    def product(i: int, values: Sequence[str]) -> str:
        terms = []
        for j, value in enumerate(values):
            if m[i, j] == 1:
                terms.append(value)
            elif m[i, j] != 0:
                terms.append(f"{PRINTER.doprint(m[i, j]) if m[i, j].is_number else f'm{i}_{j}'} * {value}")
        return " + ".join(terms) or "0.0"

    def chunk(columns: Sequence[str], indent: str, forced: bool) -> list[str]:
        lines = [f"{indent}a{i}_{q} = a[{i}, {column}]" for i in rows for q, column in enumerate(columns)]
        lines += [f"{indent}o{i}_{q} = out[{i}, {column}]" for i in rows for q, column in enumerate(columns)]
        for i in rows:
            pushed = forced and any((i, int(column)) in forcing for column in columns)
            for q, column in enumerate(columns):
                force = ""
                if pushed:  # alike in every column
                    force = f" + f{i}_{column}" if (i, int(column)) in forcing else " + 0.0"
                terms = product(i, [f"a{k}_{q}" for k in rows])
                lines.append(f"{indent}b{i}_{q} = scale * ({terms}{force})")
        lines += [f"{indent}a[{i}, {column}] = b{i}_{q}" for i in rows for q, column in enumerate(columns)]
        lines += [f"{indent}out[{i}, {column}] = o{i}_{q} + b{i}_{q}" for i in rows for q, column in enumerate(columns)]
        return lines

    used = free_symbols(e for _, e in varying) | free_symbols(forcing.values())
    lines = ["@compiled", f"def {model.name}_taylor(c, u, h, order, columns, a, out):"]
    lines += _unpack(constants, "c[{i}]", used)
    lines += assignments(varying, "w", "    ")
    lines += ["    degree = u.shape[1] - 1", "    if columns == 1:"]
    lines += [f"        {s} = out[{i}, 0]" for i, s in enumerate(states)]
    lines += [f"        total{i} = out[{i}, 0]" for i in rows]
    lines += ["        for n in range(order):", "            scale = h / (n + 1)"]
    inputs = [
        f"{s} = u[{k}, n] if n <= degree else 0.0"
        for k, s in enumerate(model.inputs)
        if s in free_symbols(forcing.values())
    ]
    lines += [f"            {line}" for line in inputs]
    for i in rows:
        force = f" + {PRINTER.doprint(input_terms[i])}" if input_terms[i] != 0 else ""
        lines.append(f"            b{i} = scale * ({product(i, [str(s) for s in states])}{force})")
    lines += [f"            {s} = b{i}" for i, s in enumerate(states)]
    lines += [f"            total{i} += b{i}" for i in rows]
    lines += [f"        out[{i}, 0] = total{i}" for i in rows]
    lines.append("        return")
    if base % 4 == 0:
        return "\n".join([_taylor_lanes(model), "", "", *lines, f"    {model.name}_taylor_lanes(c, u, h, order, out)"])
    lines.append("    for j in range(columns):")
    lines += [f"        a[{i}, j] = out[{i}, j]" for i in rows]
    lines += ["    for n in range(order):", "        scale = h / (n + 1)"]
    lines += [f"        {line}" for line in inputs]
    lines += ["    " + line for line in _unpack(states, "a[{i}, 0]", free_symbols(forcing.values()))]
    lines += assignments([(f"f{i}_{column}", e) for (i, column), e in forcing.items()], "v", "        ")
    for first in range(0, base, 4):
        lines += chunk([str(j) for j in range(first, min(first + 4, base))], "        ", forced=True)
    lines.append(f"        for j in range({base}, columns):")
    lines += chunk(["j"], "            ", forced=False)
    return "\n".join(lines)


def _width(model: Model) -> int:
    """Columns [state | ∂/∂s0 | ∂/∂flow constants] side by side, filled up to a multiple of four."""
    return -(-(1 + len(model.states) + len(model.flow_constants)) // 4) * 4


def _lanes_prologue(model: Model) -> list[str]:
    """Lines that name what the terms of a series in lanes are made of."""
    m, forcing = model.system_matrices()[0], _forcing(model)
    varying = [(f"m{i}_{j}", m[i, j]) for i in range(m.rows) for j in range(m.cols) if not m[i, j].is_number]
    used = free_symbols(e for _, e in varying) | free_symbols(e for row in forcing for e in row)
    lines = _unpack([constant.symbol for constant in model.constants], "c[{i}]", used)
    lines += assignments(varying, "w", "    ")
    lines.append("    degree = u.shape[1] - 1")
    return lines


def _forcing(model: Model) -> list[list[sp.Expr]]:
    """What is added to each row of the columns, beside M a, in every term of the series."""
    n = model.system_matrices()[1]
    columns = 1 + len(model.states) + len(model.flow_constants)
    forcing = []
    for i in range(n.rows):
        row: list[sp.Expr] = [sum((n[i, j] * model.inputs[j] for j in range(n.cols)), sp.Integer(0))]
        row += [sp.Integer(0)] * len(model.states)
        row += [sp.diff(model.field[i], constant.symbol) for constant in model.flow_constants]
        forcing.append(row + [sp.Integer(0)] * (_width(model) - columns))
    return forcing


def _named(m: sp.Matrix, i: int, j: int) -> sp.Expr:
    """An entry of the field's matrix, by the name that a prologue gives it, or the number that it is."""
    return m[i, j] if m[i, j].is_number else sp.Symbol(f"m{i}_{j}")


def _combined(weights: Sequence[sp.Expr]) -> str:
    """The sum of the lanes a0, a1, … with these weights."""
    terms = []
    for k, weight in enumerate(weights):
        if weight == 1:
            terms.append(f"a{k}")
        elif weight != 0:
            terms.append(f"{float(weight)!r} * a{k}" if weight.is_number else f"{weight} * a{k}")
    return " + ".join(terms)


def _series(model: Model, indent: str, forced: bool) -> list[str]:
    """Lines that add to the lanes total0, total1, … the terms of the series behind the lanes a0, a1, …; forced: whether
    these are the base model's columns, which have more than M a in each term.
    """
    m, _ = model.system_matrices()
    rows = range(m.rows)
    forcing = _forcing(model) if forced else [[] for _ in rows]
    forces = [(f"f{i}_{j}", e) for i in rows for j, e in enumerate(forcing[i]) if e != 0]
    used = free_symbols(e for _, e in forces)
    lines = ["for n in range(order):", "    scale = h / (n + 1)"]
    lines += [f"    {s} = u[{k}, n] if n <= degree else 0.0" for k, s in enumerate(model.inputs) if s in used]
    lines += [f"    {s.symbol} = lane(a{i}, 0)" for i, s in enumerate(model.states) if s.symbol in used]
    lines += assignments(forces, "v", "    ")
    for i in rows:
        product = _combined([_named(m, i, j) for j in rows])
        if any(e != 0 for e in forcing[i]):
            named = [f"f{i}_{j}" if e != 0 else "0.0" for j, e in enumerate(forcing[i])]
            product += f" + gather(({', '.join(named)}))"
        lines.append(f"    b{i} = scale * ({product})")
    lines += [f"    a{i} = b{i}" for i in rows]
    lines += [f"    total{i} = total{i} + b{i}" for i in rows]
    return [indent + line for line in lines]


def _taylor_lanes(model: Model) -> str:
    """`<model>_taylor_lanes(c, u, h, order, out)`: what `<model>_taylor` does with all columns of out, those of the
    base model side by side and the others, of effects, by fours; `<model>_taylor_rest` those that make no four.
    """
    rows, width = range(len(model.states)), _width(model)
    lines = ["@inlined", f"def {model.name}_taylor_lanes(c, u, h, order, out):", *_lanes_prologue(model)]
    lines.append("    columns = out.shape[1]")
    lines.append("    fours = columns - columns % 4")
    lines += [f"    a{i} = take(out, {i} * columns, {width})" for i in rows]
    lines += [f"    total{i} = a{i}" for i in rows]
    lines += _series(model, "    ", forced=True)
    lines += [f"    put(out, {i} * columns, total{i})" for i in rows]
    lines.append(f"    for j in range({width}, fours, 4):")
    lines += [f"        a{i} = take(out, {i} * columns + j, 4)" for i in rows]
    lines += [f"        total{i} = a{i}" for i in rows]
    lines += _series(model, "        ", forced=False)
    lines += [f"        put(out, {i} * columns + j, total{i})" for i in rows]
    lines += ["    if fours < columns:", f"        {model.name}_taylor_rest(c, h, order, out)"]
    more = ["@compiled", f"def {model.name}_taylor_rest(c, h, order, out):"]
    more += [line for line in _lanes_prologue(model) if "degree" not in line]
    more += ["    columns = out.shape[1]", "    for j in range(columns - columns % 4, columns, 4):"]
    for i in rows:
        there = [f"out[{i}, j]", *(f"out[{i}, j + {q}] if j + {q} < columns else 0.0" for q in (1, 2, 3))]
        more.append(f"        a{i} = gather(({', '.join(there)}))")
    more += [f"        total{i} = a{i}" for i in rows]
    more += _series(model, "        ", forced=False)
    for q in range(4):
        more.append(f"        if j + {q} < columns:")
        more += [f"            out[{i}, j + {q}] = lane(total{i}, {q})" for i in rows]
    return "\n".join([*more, "", "", *lines])


def _powers(model: Model) -> str:
    """`<model>_powers(c, h, order, out)`: out[n] ← (M h)ⁿ/n!, column by column, n up to order: the terms of exp(M h).
    Models of four states only, so that columns are lanes.
    """
    m, _ = model.system_matrices()
    rows = range(m.rows)
    lines = ["@compiled", f"def {model.name}_powers(c, h, order, out):"]
    lines += [line for line in _lanes_prologue(model) if "degree" not in line]
    for j in rows:
        lines.append(f"    a{j} = gather(({', '.join('1.0' if i == j else '0.0' for i in rows)}))")
        lines.append(f"    put(out, {4 * j}, a{j})")
    lines += ["    for n in range(order):", "        scale = h / (n + 1)"]
    lines += [f"        b{j} = scale * ({_combined([_named(m, i, j) for i in rows])})" for j in rows]
    lines += [f"        a{j} = b{j}" for j in rows]
    lines += [f"        put(out, 16 * n + {16 + 4 * j}, a{j})" for j in rows]
    return "\n".join(lines)


def _add_constants(model: Model) -> str:
    """`<model>_add_constants(c, e, out)`: add to the columns of the flow constants in out what changes of the field's
    entries do.  Models of two axes only.

    e (4, 8): what a unit of each state added to the force of each axis, [of x | of y], does to the states.
    """
    states = [state.symbol for state in model.states]
    first = 1 + len(states)
    pairs = []
    for j, constant in enumerate(model.flow_constants):
        entries = {
            4 * axis + k: entry
            for axis in range(model.axes)
            for k, state in enumerate(states)
            if (entry := sp.diff(model.field[2 * axis + 1], constant.symbol, state)) != 0
        }
        pairs += [
            (f"out[{i}, {first + j}]", sum(entry * sp.Symbol(f"e[{i}, {at}]") for at, entry in entries.items()))
            for i in range(len(states))
        ]
    constants = [constant.symbol for constant in model.constants]
    lines = ["@compiled", f"def {model.name}_add_constants(c, e, out):"]
    lines += _unpack(constants, "c[{i}]", free_symbols(e for _, e in pairs))
    lines += [f"    {place} += {PRINTER.doprint(e)}" for place, e in pairs]
    return "\n".join(lines)


def _flow_lanes(model: Model) -> str:
    """`<model>_flow_lanes(c, s, u, h, order, out)`: the flow and its sensitivities over h, all columns side by side.

    out[:w · rows] ← the rows of [state | ∂/∂s0 | ∂/∂flow constants], w numbers each (the columns, filled up to a
    multiple of four); out[w · rows:] ← the same column by column.  Models of four states only, so that columns, too,
    are lanes.
    """
    rows, width = range(len(model.states)), _width(model)
    lines = ["@inlined", f"def {model.name}_flow_lanes(c, s, u, h, order, out):", *_lanes_prologue(model)]
    for i in rows:
        ones = ["1.0" if j == 1 + i else "0.0" for j in range(1, width)]
        lines.append(f"    a{i} = gather(({', '.join([f's[{i}]', *ones])}))")
        lines.append(f"    total{i} = a{i}")
    lines += _series(model, "    ", forced=True)
    lines += [f"    put(out, {i * width}, total{i})" for i in rows]
    lines.append(f"    put_columns(out, {len(rows) * width}, {', '.join(f'total{i}' for i in rows)})")
    return "\n".join(lines)


def _sense(model: Model) -> str:
    """`<model>_sense(c, s, z, jacobian)`: predicted measurement and the nonzero entries of its derivative by X."""
    states = [state.symbol for state in model.states]
    constants = [constant.symbol for constant in model.constants]
    jacobian = sp.Matrix(model.measurement).jacobian(states + constants)
    pairs = [(f"z[{i}]", e) for i, e in enumerate(model.measurement)]
    cells = [(i, j) for i in range(jacobian.rows) for j in range(jacobian.cols) if jacobian[i, j] != 0]
    pairs += [(f"jacobian[{i}, {j}]", jacobian[i, j]) for i, j in cells]
    used = free_symbols(e for _, e in pairs)
    lines = ["@compiled", f"def {model.name}_sense(c, s, z, jacobian):"]
    lines += _unpack(constants, "c[{i}]", used) + _unpack(states, "s[{i}]", used)
    lines += assignments(pairs, "w", "    ")
    return "\n".join(lines)


def _jumps(model: Model) -> str:
    """`<model>_jump(s, constant, out)`: what a unit jump of a constant does to the states."""
    lines = ["@compiled", f"def {model.name}_jump(s, constant, out):", "    out[:] = 0.0"]
    states = [state.symbol for state in model.states]
    for index, constant in enumerate(model.constants):
        if constant.jump:
            lines.append(f"    if constant == {index}:")
            lines += ["    " + line for line in _unpack(states, "s[{i}]", free_symbols(constant.jump.values()))]
            lines += [f"        out[{states.index(s)}] = {PRINTER.doprint(e)}" for s, e in constant.jump.items()]
    return "\n".join(lines)


_EFFECT_ARGUMENTS = "c, s, u, w, first, signal, value, by_states, by_constants"


def _additions(model: Model, effect: Effect, what: str) -> list[tuple[str, int, int, sp.Expr]]:
    """What an effect adds to force or sense, where it is not zero: to `value` of an axis, to `by_states` of an axis and
    a state, to `by_constants` of an axis and a constant, to `by_own` of an axis and one of its coefficients, to
    `by_signal` of one of its signals that depends on the way of that axis.
    """
    states = [state.symbol for state in model.states]
    constants = [constant.symbol for constant in model.constants]
    coefficients = [coefficient.symbol for coefficient in effect.coefficients]
    flowing = [constants.index(constant.symbol) for constant in model.flow_constants]
    found = []
    for axis, expression in enumerate(getattr(effect, what)[: model.axes]):
        found.append(("value", axis, 0, expression))
        found += [("by_states", axis, j, sp.diff(expression, s)) for j, s in enumerate(states)]
        found += [("by_own", axis, j, sp.diff(expression, c)) for j, c in enumerate(coefficients)]
        found += [("by_constants", axis, j, sp.diff(expression, constants[j])) for j in flowing]
        if what == "force":
            found += [
                ("by_states", axis, 2 * signal.axis + 1, sp.diff(expression, signal.symbol) * _slope(signal))
                for signal in effect.signals
                if signal.source is Source.DIRECTION and signal.axis < model.axes
            ]
            found += [
                ("by_signal", axis, j, sp.diff(expression, signal.symbol))
                for j, signal in enumerate(effect.signals)
                if signal.source in OF_THE_WAY and signal.axis == axis
            ]
    return [(kind, axis, j, sp.sympify(e)) for kind, axis, j, e in found if e != 0]


def _slope(signal: Signal) -> sp.Symbol:
    """Derivative of a direction by the velocity of its axis."""
    return sp.Symbol(f"slope_of_{signal.symbol}")


def _body(model: Model, effect: Effect, what: str, places: Mapping[str, str], sources: Mapping[str, str]) -> list[str]:
    """Lines that add it; `places` says where each kind of addition goes, `sources` where each kind of symbol is."""
    pairs = [(places[kind].format(axis=axis, j=j), e) for kind, axis, j, e in _additions(model, effect, what)]
    used = free_symbols(e for _, e in pairs)
    lines = []
    for kind, symbols in (
        ("constants", [constant.symbol for constant in model.constants]),
        ("coefficients", [coefficient.symbol for coefficient in effect.coefficients]),
        ("states", [state.symbol for state in model.states]),
        ("inputs", model.inputs),
        ("signals", [signal.symbol for signal in effect.signals]),
        ("slopes", [_slope(signal) for signal in effect.signals]),
    ):
        lines += _unpack(symbols, sources[kind], used)
    lines += [line.replace("] = ", "] += ", 1) for line in assignments(pairs, sources["shared"], "    ")]
    return lines if pairs else ["    return"]


_PLACES = {
    "value": "value[{axis}]",
    "by_states": "by_states[{axis}, {j}]",
    "by_own": "by_constants[{axis}, first + {j}]",
    "by_constants": "by_constants[{axis}, {j}]",
    "by_signal": f"w[{MAX_SIGNALS} + signal + {{j}}]",
}
_SOURCES = {
    "constants": "c[{i}]",
    "coefficients": "c[first + {i}]",
    "states": "s[{i}]",
    "inputs": "u[{i}]",
    "signals": "w[signal + {i}]",
    "slopes": f"w[{MAX_SIGNALS} + signal + {{i}}]",
    "shared": "t",
}


def _effects(model: Model, effects: Sequence[Effect], what: str) -> str:
    """`<model>_effects_<what>`: adds what the effect of that number does to the force, or to the sensed displacement,
    and its derivatives to what is there.

    Arguments: number of the effect, constants c, states s, drive u, signals w, index of the first coefficient among the
    constants and of the first signal in w, then what to add to: values (axes,), derivatives by states (axes, states)
    and by constants (axes, constants).  What is clipped is not differentiated by the offset in it: that is of the
    effect's second order.  One function for all, since each function costs Numba more than what is in it.
    """
    lines = ["@branching", f"def {model.name}_effects_{what}(effect, {_EFFECT_ARGUMENTS}):"]
    branch = "if"
    for number, effect in enumerate(effects):
        present = effect.on(model.axes)
        if present is not None and any(expression != 0 for expression in getattr(present, what)):
            lines.append(f"    {branch} effect == {number}:")
            lines += ["    " + line for line in _body(model, present, what, _PLACES, _SOURCES)]
            branch = "elif"
    return "\n".join(lines)


_OWN_HEADER = '''"""Generated from the declaration of one effect; not to be edited."""

import math

from estimator.kernel.own import reached_by_address

'''
_OWN_ARGUMENTS = (
    "_c, _s, _step, _u, _w, _first, _signal, _value, _by_states, _states_row, _by_constants, _constants_row"
)
_OWN_PLACES = {
    "value": "_value[{axis}]",
    "by_states": "_by_states[{axis} * _states_row + {j}]",
    "by_own": "_by_constants[{axis} * _constants_row + _first + {j}]",
    "by_constants": "_by_constants[{axis} * _constants_row + {j}]",
    "by_signal": f"_w[{MAX_SIGNALS} + _signal + {{j}}]",
}
_OWN_SOURCES = {
    "constants": "_c[{i}]",
    "coefficients": "_c[_first + {i}]",
    "states": "_s[{i} * _step]",
    "inputs": "_u[{i}]",
    "signals": "_w[_signal + {i}]",
    "slopes": f"_w[{MAX_SIGNALS} + _signal + {{i}}]",
    "shared": "_t",
}


def own_effect(model: Model, effect: Effect) -> str:
    """Source of a module with `add(what, …)`, the function behind an address (`estimator.kernel.pointer`) that does for
    one effect what the generated dispatchers do for the catalogue.

    Its own names begin with an underscore, so that a coefficient may have any other.
    """
    lines = [_OWN_HEADER, "@reached_by_address", f"def add(_what, {_OWN_ARGUMENTS}):"]
    for number, what in ((FORCE, "force"), (SENSE, "sense")):
        body = _body(model, effect, what, _OWN_PLACES, _OWN_SOURCES)
        if body != ["    return"]:
            lines += [f"    if _what == {number}:", *("    " + line for line in body)]
    return "\n".join([*lines, "    return 0"]) + "\n"


def _dispatch_effects(models: Sequence[Model], what: str) -> str:
    lines = ["@branching", f"def effect_{what}(effect, model, {_EFFECT_ARGUMENTS}):"]
    lines += ["    if effect >= LEAST_ADDRESS:", f"        call_{what}(effect, {_EFFECT_ARGUMENTS})"]
    for index, model in enumerate(models):
        lines += [f"    elif model == {index}:", f"        {model.name}_effects_{what}(effect, {_EFFECT_ARGUMENTS})"]
    return "\n".join(lines)


def _dispatch(models: Sequence[Model], stem: str, arguments: str) -> str:
    lines = ["@inlined", f"def {stem}(model, {arguments}):"]
    for number, model in enumerate(models):
        lines += [
            f"    {'if' if number == 0 else 'elif'} model == {number}:",
            f"        {model.name}_{stem}({arguments})",
        ]
    return "\n".join(lines)


def generate(models: Sequence[Model], effects: Sequence[Effect]) -> str:
    """Source of the module that holds every model's and effect's functions and the dispatchers over them."""
    parts = [build(model) for model in models for build in (_field_columns, _taylor, _sense, _jumps)]
    parts += [
        build(model) for model in models if len(model.states) == 4 for build in (_flow_lanes, _powers, _add_constants)
    ]
    for what in ("force", "sense"):
        parts += [_effects(model, effects, what) for model in models]
        parts.append(_dispatch_effects(models, what))
    parts += [
        _dispatch(models, "field_columns", "c, a, u, out, columns"),
        _dispatch(models, "taylor", "c, u, h, order, columns, a, out"),
        _dispatch(models, "sense", "c, s, z, jacobian"),
        _dispatch(models, "jump", "s, constant, out"),
    ]
    return _HEADER + "\n\n\n".join(parts) + "\n"
