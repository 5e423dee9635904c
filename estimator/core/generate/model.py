"""Functions of one model: its field on columns, its Taylor series, its measurement, its jumps.

A step of the flow is a Taylor series: with s' = M(c) s + N(c) u the coefficients follow a[n+1] = (M a[n] + N u[n]) / (n
+ 1), and the sensitivities to initial state and constants obey the same recursion with dM/dc a[n] + dN/dc u[n] added.
So one function serves values and Jacobian alike, on columns [state | by the state | by the flow constants].
"""

from collections.abc import Mapping, Sequence

import sympy as sp

from estimator.core.generate.printer import assignments, free_symbols, loads, written
from estimator.model.declaration import Model

SIGNATURES = {
    "field_columns": ("const real *c, const real *a, const real *u, real *out, whole columns,\n    whole stride"),
    "taylor_columns": (
        "const real *c, const real *u, whole terms, real h, whole order, whole columns,\n"
        "    real *a, real *out, whole stride"
    ),
    "first_term": (
        "const real *c, const real *s, const real *rest, const real *u, whole terms,\n    real h, double *out"
    ),
    "sense": "const real *c, const real *s, real *z, real *jacobian, whole stride",
    "jump": "const real *s, whole constant, real *out",
    "powers": "const real *c, real h, whole order, real *out",
    "add_constants": "const real *c, const real *e, real *out, whole stride",
}
"""What each function takes, whatever the model."""


class Field:
    """A model's field as functions of its columns need it: M's entries, and what is added in each row."""

    def __init__(self, model: Model) -> None:
        self.m, n = model.system_matrices()
        self.rows = range(self.m.rows)
        self.states = [state.symbol for state in model.states]
        self.constants = {constant.symbol: f"c[{i}]" for i, constant in enumerate(model.constants)}
        self.inputs = list(model.inputs)
        self.varying = [
            (f"const real m{i}_{j}", self.m[i, j])
            for i in self.rows for j in self.rows if not self.m[i, j].is_number
        ]  # fmt: skip
        self.driven = {i: e for i in self.rows if (e := sum(n[i, j] * u for j, u in enumerate(self.inputs))) != 0}
        self.forced = {
            (i, 1 + len(self.states) + j): e
            for j, constant in enumerate(model.flow_constants)
            for i in self.rows
            if (e := sp.diff(model.field[i], constant.symbol)) != 0
        }

    def prologue(self) -> list[str]:
        """Constants by name, M's entries."""
        used = free_symbols(e for _, e in self.varying) | free_symbols([*self.driven.values(), *self.forced.values()])
        return loads(self.constants, used) + assignments(self.varying, "w")

    def product(self, row: int, of: Sequence[str]) -> str:
        """Row of M times what stands in these places."""
        terms = []
        for j, place in enumerate(of):
            entry = self.m[row, j]
            if entry == 1:
                terms.append(place)
            elif entry != 0:
                terms.append(f"{written(entry) if entry.is_number else f'm{row}_{j}'} * {place}")
        return " + ".join(terms) or "R(0.0)"

    def lanes(self, row: int, of: Sequence[str]) -> str:
        """The same of four columns each."""
        total = ""
        for j, lane in enumerate(of):
            entry = self.m[row, j]
            if entry != 0:
                name = written(entry) if entry.is_number else f"m{row}_{j}"
                term = lane if entry == 1 else f"scale4({name}, {lane})"
                total = f"add4({total}, {term})" if total else term
        return total


def _indented(lines: Sequence[str], by: int = 4) -> list[str]:
    return [" " * by + line for line in lines]


def _function(model: Model, stem: str, lines: Sequence[str]) -> str:
    return "\n".join([f"static inline void {model.name}_{stem}({SIGNATURES[stem]})", "{", *_indented(lines), "}"])


def field_columns(model: Model) -> str:
    """`<model>_field_columns`: out = M a in each column, and what the drive and the constants force."""
    field = Field(model)
    lines = field.prologue()
    lines.append("for (whole j = 0; j < columns; j++) {")
    for i in field.rows:
        product = field.product(i, [f"a[{k} * stride + j]" for k in field.rows])
        lines.append(f"    out[{i} * stride + j] = {product};")
    lines.append("}")
    used = free_symbols([*field.driven.values(), *field.forced.values()])
    lines += loads({u: f"u[{k}]" for k, u in enumerate(field.inputs)}, used)
    lines += [f"out[{i} * stride] += {written(e)};" for i, e in field.driven.items()]
    lines += ["if (columns == 1)", "    return;"]
    lines += loads({s: f"a[{i} * stride]" for i, s in enumerate(field.states)}, free_symbols(field.forced.values()))
    lines += [f"out[{i} * stride + {j}] += {written(e)};" for (i, j), e in field.forced.items()]
    return _function(model, "field_columns", lines)


def taylor(model: Model) -> str:
    """`<model>_taylor_columns`: the columns of out advanced by their Taylor series over h under the drive u (axes,
    terms), a polynomial in normalised time; a is scratch of out's shape; columns is 1 or all, in fours.  Of all in 32
    bits the first becomes the terms of the state's series behind the first one, which `<model>_first_term` gives.
    """
    field = Field(model)
    rows = field.rows
    used_inputs = free_symbols([*field.driven.values(), *field.forced.values()])
    inputs = [
        f"const real {u} = n < terms ? u[{k} * terms + n] : R(0.0);"
        for k, u in enumerate(field.inputs) if u in used_inputs
    ]  # fmt: skip
    series = ["for (whole n = 0; n < order; n++) {", "    const real scale = h / (real)(n + 1);"]
    lines = [*field.prologue(), "if (columns == 1) {"]
    lines += [f"    real {s} = out[{i} * stride], total{i} = {s};" for i, s in enumerate(field.states)]
    lines += _indented([*series, *_indented(inputs)])
    for i in rows:
        drive = f" + {written(field.driven[i])}" if i in field.driven else ""
        lines.append(f"        const real b{i} = scale * ({field.product(i, [str(s) for s in field.states])}{drive});")
    lines += [f"        {s} = b{i}, total{i} += b{i};" for i, s in enumerate(field.states)]
    lines += ["    }", *(f"    out[{i} * stride] = total{i};" for i in rows), "    return;", "}"]
    lines += [f"real *restrict a{i} = a + {i} * stride, *restrict o{i} = out + {i} * stride;" for i in rows]
    lines += ["for (whole j = 0; j < columns; j++) {"]
    lines += [f"    a{i}[j] = o{i}[j];" for i in rows] + ["}"]
    lines += [*series, *_indented(inputs)]
    named = {s: f"a{i}[0]" for i, s in enumerate(field.states)}
    forces = [(f"const real f{i}_{j}", e) for (i, j), e in field.forced.items()]
    lines += _indented(loads(named, free_symbols(field.forced.values())) + assignments(forces, "v"))
    pushed = {(i, 0): f"({written(e)})" for i, e in field.driven.items()} | {
        (i, j): f"f{i}_{j}" for i, j in field.forced
    }
    lines += _indented(_by_lanes(field, pushed))
    lines += ["#ifdef CORE_FLOAT32", "    if (n == 0)", f"        {' = '.join(f'o{i}[0]' for i in rows)} = R(0.0);"]
    lines += ["#endif", "}"]
    return _function(model, "taylor_columns", lines)


def _by_lanes(field: Field, pushed: Mapping[tuple[int, int], str]) -> list[str]:
    """The next term of all columns, `pushed` in some of their rows, and its sum, four at a time: single numbers that
    were stored could not be loaded as four at once.
    """
    blocks = max(j for _, j in pushed) // 4 + 1
    driven = sorted({i for i, _ in pushed})
    lines = []
    for i in driven:
        fours = (
            ", ".join(f"scale * {pushed[i, j]}" if (i, j) in pushed else "R(0.0)" for j in range(4 * at, 4 * at + 4))
            for at in range(blocks)
        )
        lines.append(f"const four p{i}[{blocks}] = {{{', '.join(f'four_of({four})' for four in fours)}}};")
    lines += ["for (whole j = 0; j < columns; j += 4) {"]
    lines += [f"    const four q{i} = take4(a{i} + j);" for i in field.rows]
    for i in field.rows:
        lines.append(f"    four b{i} = scale4(scale, {field.lanes(i, [f'q{k}' for k in field.rows])});")
    lines += [f"    if (j < {4 * blocks}) {{", *(f"        b{i} = add4(b{i}, p{i}[j / 4]);" for i in driven), "    }"]
    for i in field.rows:
        lines += [f"    put4(a{i} + j, b{i});", f"    put4(o{i} + j, add4(take4(o{i} + j), b{i}));"]
    return [*lines, "}"]


def first_term(model: Model) -> str:
    """`<model>_first_term`: h times the field at a state s, in 64 bits; rest [of states | of constants] is what 32 bits
    do not hold of them; u (axes, terms).
    """
    states = {state.symbol: f"(double)s[{i}] + (double)rest[{i}]" for i, state in enumerate(model.states)}
    first = len(states)
    constants = {c.symbol: f"(double)c[{i}] + (double)rest[{first + i}]" for i, c in enumerate(model.constants)}
    inputs = {u: f"(double)u[{k} * terms]" for k, u in enumerate(model.inputs)}
    lines = loads(constants | states | inputs, free_symbols(model.field))
    lines += assignments([(f"out[{i}]", e) for i, e in enumerate(model.field)], "w")
    lines += [f"out[{i}] *= (double)h;" for i in range(first)]
    lines = [line.replace("const real ", "const double ").replace("R(", "(") for line in lines]
    return f"#ifdef CORE_FLOAT32\n{_function(model, 'first_term', lines)}\n#endif"


def powers(model: Model) -> str:
    """`<model>_powers`: out[n] <- (M h)^n/n!, column by column, n up to order: the terms of exp(M h)."""
    field = Field(model)
    rows = field.rows
    used = free_symbols(e for _, e in field.varying)
    lines = loads(field.constants, used) + assignments(field.varying, "w")
    ones = [["R(1.0)" if i == j else "R(0.0)" for i in rows] for j in rows]
    lines += [f"four a{j} = four_of({', '.join(ones[j])});" for j in rows]
    lines += [f"put4(out + {4 * j}, a{j});" for j in rows]
    lines += ["for (whole n = 0; n < order; n++) {", "    const real scale = h / (real)(n + 1);"]
    for j in rows:  # column j of M^(n+1) = M^n M
        terms = [(f"a{i}", field.m[i, j], f"m{i}_{j}") for i in rows if field.m[i, j] != 0]
        lanes = [
            f"scale4({written(entry) if entry.is_number else name}, {lane})" if entry != 1 else lane
            for lane, entry, name in terms
        ]
        total = lanes[0]
        for lane in lanes[1:]:
            total = f"add4({total}, {lane})"
        lines.append(f"    const four b{j} = scale4(scale, {total});")
    lines += [f"    a{j} = b{j};" for j in rows]
    lines += [f"    put4(out + 16 * n + {16 + 4 * j}, a{j});" for j in rows] + ["}"]
    return _function(model, "powers", lines)


def add_constants(model: Model) -> str:
    """`<model>_add_constants`: to the columns of the flow constants what changes of the field's entries do; e (4, 8):
    what a unit of each state added to the force of each axis, [of x | of y], does to the states.
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
        for i in range(len(states)):
            changed = sum(entry * sp.Symbol(f"e[{8 * i + at}]") for at, entry in entries.items())
            pairs.append((f"out[{i} * stride + {first + j}]", changed))
    constants = {constant.symbol: f"c[{i}]" for i, constant in enumerate(model.constants)}
    lines = loads(constants, free_symbols(e for _, e in pairs))
    lines += [f"{place} += {written(e)};" for place, e in pairs]
    return _function(model, "add_constants", lines)


def sense(model: Model) -> str:
    """`<model>_sense`: predicted measurement and the nonzero entries of its derivative by X, rows of `stride`."""
    states = {state.symbol: f"s[{i}]" for i, state in enumerate(model.states)}
    constants = {constant.symbol: f"c[{i}]" for i, constant in enumerate(model.constants)}
    jacobian = sp.Matrix(model.measurement).jacobian([*states, *constants])
    pairs = [(f"z[{i}]", e) for i, e in enumerate(model.measurement)]
    pairs += [
        (f"jacobian[{i} * stride + {j}]", jacobian[i, j])
        for i in range(jacobian.rows) for j in range(jacobian.cols) if jacobian[i, j] != 0
    ]  # fmt: skip
    lines = loads(constants | states, free_symbols(e for _, e in pairs)) + assignments(pairs, "w")
    return _function(model, "sense", lines)


def jump(model: Model) -> str:
    """`<model>_jump`: what a unit jump of a constant does to the states."""
    states = {state.symbol: f"s[{i}]" for i, state in enumerate(model.states)}
    lines = ["(void)s;", f"for (whole i = 0; i < {len(states)}; i++)", "    out[i] = R(0.0);"]
    for index, constant in enumerate(model.constants):
        if constant.jump:
            lines.append(f"if (constant == {index}) {{")
            lines += _indented(loads(states, free_symbols(constant.jump.values())))
            lines += [f"    out[{list(states).index(s)}] = {written(e)};" for s, e in constant.jump.items()]
            lines.append("}")
        elif index == 0:
            lines.insert(0, "(void)constant;")
    return _function(model, "jump", lines)


def functions(model: Model) -> list[str]:
    """All of one model."""
    found = [field_columns(model), taylor(model), first_term(model), sense(model), jump(model)]
    if len(model.states) == 4:
        found += [powers(model), add_constants(model)]
    return found
