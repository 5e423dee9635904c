"""From one model and a set of effects to the source of a filter step of its own: the specialised step.

The same filter as `estimator.kernel.observer`, written for one number of constants, one set of effects and the sparsity
of both: F is [Fs Fc; 0 I] with four rows that are not the identity's, a row of the measurement has the entries it has,
and each measurement, of one axis or of a constant against its initial value, is taken in on its own, which for
uncorrelated noise is the same as both at once.  Covariances are in vector registers.  The observer of 13 states without
effects (`estimator.kernel.plain`) is the instance with no effect.

A covariance is a flat array with a row for each entry: columns 0–3 the states, then the constants, then zeros up to a
multiple of four.  It is symmetric, and what stands left of the constants' diagonal block is neither kept nor read.

The flow with effects is that of `estimator.kernel.flow`, impulses between exact drifts, by other arithmetic.  A drift
is the matrix E(τ) = exp(Mτ) of its length, of which there are four.  The states pass through drifts and impulses once;
what a change after each of them does to the end, the adjoint Λ, comes back through them.  A constant k of the linear
part moves the end by Σ ∫ Λ(τ) ∂M/∂k x(τ) dτ over the drifts, each by Gauss's rule of three points: an error of 1e-9 of
what it is at twenty samples a cycle (`estimator.kernel.layout.LONGEST_STEP`).
"""

from collections.abc import Sequence
from string import Template

import sympy as sp

from estimator.effects.declaration import Effect, Source
from estimator.kernel.generate.model import PRINTER, assignments, free_symbols
from estimator.kernel.generate.step_text import FLOW_HEAD, MODULE
from estimator.kernel.layout import MAX_SIGNALS
from estimator.model.declaration import Model

_IN_TIME = (Source.COSINE, Source.SINE, Source.DECAY, Source.TIME)
_STATES = 4


def step_source(model: Model, effects: Sequence[Effect]) -> str:
    """Source of the module for a model of two axes with these effects, all their coefficients estimated."""
    return _Step(model, effects).source()


class _Step:
    """One model and its effects, their symbols made distinct."""

    def __init__(self, model: Model, effects: Sequence[Effect]) -> None:
        self.model = model
        self.states = list(sp.symbols(f"q:{_STATES}"))
        named = dict(zip((state.symbol for state in model.states), self.states, strict=True))
        self.field = [sp.sympify(expression).subs(named) for expression in model.field]
        self.constants = [constant.symbol for constant in model.constants]
        self.first_flowing = len(model.sense_constants)
        self.force = [sp.Integer(0), sp.Integer(0)]
        self.sensed = [sp.sympify(expression).subs(named) for expression in model.measurement]
        self.signals: list[sp.Symbol] = []
        self.in_time: set[sp.Basic] = set()
        for number, effect in enumerate(effects):
            own = {c.symbol: sp.Symbol(f"e{number}_{i}") for i, c in enumerate(effect.coefficients)}
            self.constants += own.values()
            signals = {s.symbol: sp.Symbol(f"g{number}_{i}") for i, s in enumerate(effect.signals)}
            distinct = {**named, **own, **signals}
            self.signals += signals.values()
            self.in_time |= {signals[s.symbol] for s in effect.signals if s.source in _IN_TIME}
            for axis in range(2):
                self.force[axis] += sp.sympify(effect.force[axis]).subs(distinct, simultaneous=True)
                self.sensed[axis] += sp.sympify(effect.sense[axis]).subs(distinct, simultaneous=True)
        self.count = len(self.constants)
        self.size = _STATES + self.count
        self.lanes = -(-self.count // 4) * 4  # of the constants in a row
        self.flowing = self.constants[self.first_flowing :]
        self.forced = any(expression != 0 for expression in self.force)
        moving = self.flowing if self.forced else model.flow_constants  # else the base model's flow does
        self.columns = -(-(1 + _STATES + len(moving)) // 4) * 4

    # -- pieces of text ----------------------------------------------------------------------------------------------

    def source(self) -> str:
        """The module."""
        flow = self._flow() if self.forced else ""
        fields = {
            "model": self.model.name,
            "constants": self.count,
            "lanes": self.lanes,
            "width": _STATES + self.lanes,
            "columns": self.columns,
            "signals": MAX_SIGNALS,
            "flow": flow,
            "move": self._move(),
            "apart": self._propagation(),
            "angle": self._angle(),
            "sense": self._sense(),
            "innovations": self._innovations(),
            "measures": "\n\n\n".join(self._measure(axis) for axis in range(2)),
        }
        return Template(MODULE).substitute({name: str(value) for name, value in fields.items()})

    def _unpacked(self, used: set[sp.Basic], states: str, signals: str, indent: str) -> list[str]:
        lines = []
        for symbols, where in ((self.states, states), (self.constants, "c[{i}]"), (self.signals, signals)):
            lines += [f"{indent}{s} = {where.format(i=i)}" for i, s in enumerate(symbols) if s in used]
        lines += [f"{indent}{s} = u[{i}, 0]" for i, s in enumerate(self.model.inputs) if s in used]
        return lines

    def _move(self) -> str:
        """Lines that leave the flow and its derivatives in work."""
        lines = []
        if self.signals:
            lines += ["signals = work[_SIGNALS : _SIGNALS + 2 * MAX_SIGNALS]"]
            lines += ["signal_values(settings, memory, memory.time, signals)"]
        if self.forced:
            lines += ["flow(settings, memory, x[STATES:], x, u, h, work)"]
        else:
            lines += [f"_{self.model.name}_flow_lanes(x[STATES:], x, u, h, settings.order, work)"]
        lines += ["put(x, 0, take(work, _COLUMNS, 4))"]
        if self.signals:
            lines += ["advance_signals(settings, memory, x[STATES:], u, h)"]
        return "\n".join("    " + line for line in lines)

    def _entry(self, i: str, j: int) -> str:
        """∂(state i of the end)/∂(column j of the flow) in work."""
        return f"work[_COLUMNS + {4 * (j + 1)} + {i}]" if self.forced else f"work[f + {j + 1}]"

    def _behind(self) -> list[tuple[int, int]]:
        """(number of a constant, its column of the flow behind those of the states): those that move something."""
        moved = self._moving()
        return [(self.first_flowing + k, _STATES + k) for k in range(len(self.flowing)) if self.flowing[k] in moved]

    def _moving(self) -> set[sp.Basic]:
        field = free_symbols(self.field) | free_symbols(self.force)
        return {constant for constant in self.flowing if constant in field}

    def _propagation(self) -> str:
        w = "_W"
        wide = self.lanes
        left = " + ".join(f"{self._entry('i', j)} * take(p, {j} * {w}, 4)" for j in range(_STATES))
        a = " + ".join(f"{self._entry('i', j)} * take(p, {j} * {w} + 4, {wide})" for j in range(_STATES))
        b = " + ".join(
            f"{self._entry('i', column)} * take(p, {_STATES + k} * {w} + 4, {wide})" for k, column in self._behind()
        )
        d = [f"lane(left, {j}) * take(work, _COLUMNS + {4 * (j + 1)}, 4)" for j in range(_STATES)]
        d += [f"lane(right, {k}) * take(work, _COLUMNS + {4 * (column + 1)}, 4)" for k, column in self._behind()]
        lines = [] if self.forced else ["f = _FLOW * i"]
        lines += [f"a = {a}", f"b = {b}", f"left = 0.5 * ({left})", "right = a + 0.5 * b", f"d = {' + '.join(d)}"]
        return "\n".join("        " + line for line in lines)

    def _angle(self) -> str:
        """The states' part of the angle's covariances by the flow."""
        terms = [f"lane(s, {j}) * take(work, _COLUMNS + {4 * (j + 1)}, 4)" for j in range(_STATES)]
        terms += [f"lane(k, {k}) * take(work, _COLUMNS + {4 * (column + 1)}, 4)" for k, column in self._behind()]
        return " + ".join(terms)

    # -- measurement ---------------------------------------------------------------------------------------------------

    def _rows(self, axis: int) -> list[tuple[int, sp.Expr]]:
        """(entry, derivative) of what an axis shows."""
        unknowns = [*self.states, *self.constants]
        found = [(i, sp.diff(self.sensed[axis], symbol)) for i, symbol in enumerate(unknowns)]
        return [(i, e) for i, e in found if e != 0]

    def _weight(self, axis: int, i: int, e: sp.Expr) -> str:
        """Of entry i in what an axis shows: nothing where it is one."""
        return "" if e == 1 else f"work[_H + {axis * self.size + i}] * "

    def _sense(self) -> str:
        """Lines that compute what both axes are predicted to show, and the derivatives that are not one."""
        pairs = [(f"shown_{axis}", self.sensed[axis]) for axis in range(2)]
        pairs += [(f"work[_H + {axis * self.size + i}]", e) for axis in range(2) for i, e in self._rows(axis) if e != 1]
        used = free_symbols(e for _, e in pairs)
        lines = ["    c = x[STATES:]"]
        if used & set(self.signals):
            lines += ["    signals = work[_SIGNALS : _SIGNALS + 2 * MAX_SIGNALS]"]
            lines += ["    signal_values(settings, memory, memory.time + h, signals)"]
        lines += self._unpacked(used, "x[{i}]", "signals[{i}]", "    ")
        return "\n".join(lines + assignments(pairs, "w", "    "))

    def _innovations(self) -> str:
        """Lines for innovation and variance of both axes, before either is taken in."""
        lines = []
        for axis in range(2):
            terms = []
            rows = self._rows(axis)
            for n, (i, e) in enumerate(rows):
                for j, f in rows[n:]:
                    twice = "2.0 * " if j != i else ""
                    terms.append(f"{twice}{self._weight(axis, i, e)}{self._weight(axis, j, f)}c[_W * {i} + {j}]")
            lines += [
                f"    usable = np.isfinite(z[{axis}])",
                "    measured = measured or usable",
                f"    row.nu[{axis}] = z[{axis}] - shown_{axis} if usable else 0.0",
                f"    row.s[{axis}] = settings.noise[{axis}]",
                "    if usable:",
                f"        row.s[{axis}] += {' + '.join(terms)}",
            ]
        return "\n".join(lines).replace(" c[", " covariance[")

    def _measure(self, axis: int) -> str:
        """`measure_<axis>`: what an axis shows, taken in."""
        rows = self._rows(axis)

        def states_of(matrix: str) -> str:
            terms = []
            for i, e in rows:
                weight = self._weight(axis, i, e)
                if i < _STATES:
                    terms.append(f"{weight}take({matrix}, {i} * _W, 4)")
                else:
                    terms.append(f"{weight}gather(({', '.join(f'{matrix}[{j} * _W + {i}]' for j in range(_STATES))}))")
            return " + ".join(terms)

        def constants_of(matrix: str) -> str:
            return " + ".join(f"{self._weight(axis, i, e)}take({matrix}, {i} * _W + 4, {self.lanes})" for i, e in rows)

        def variance_of(states: str, constants: str) -> str:
            return " + ".join(
                f"{self._weight(axis, i, e)}"
                + (f"lane({states}, {i})" if i < _STATES else f"lane({constants}, {i - _STATES})")
                for i, e in rows
            )

        seen = " + ".join(f"{self._weight(axis, i, e)}work[_ANGLE + {i}]" for i, e in rows)
        other = 1 - axis
        moves_other = " + ".join(f"{self._weight(other, i, e)}work[_Y + {i}]" for i, e in self._rows(other))
        return "\n".join(
            [
                "@compiled",
                f"def measure_{axis}(innovation, noise, estimate, work):",
                f'    """What axis {axis} shows, taken in; returns (ν/√S, what a unit of that moves the other by)."""',
                "    p, c = estimate.p, estimate.c",
                f"    ps = {states_of('p')}",
                f"    cs = {states_of('c')}",
                f"    pc = {constants_of('p')}",
                f"    cc = {constants_of('c')}",
                f"    sp = noise + {variance_of('ps', 'pc')}",
                f"    sc = noise + {variance_of('cs', 'cc')}",
                f"    seen = {seen}",
                "    shown = Projected(ps, pc, sp, cs, cc, sc, seen)",
                "    whitened = take_in(innovation, shown, estimate, work)",
                f"    return whitened, {moves_other}",
            ]
        )

    # -- flow ----------------------------------------------------------------------------------------------------------

    def _flow(self) -> str:
        m, n = self.model.system_matrices()
        rows = range(_STATES)
        matrix = [(f"m{i}_{j}", m[i, j]) for i in rows for j in rows if not m[i, j].is_number]
        inputs = [sum((n[i, j] * self.model.inputs[j] for j in range(n.cols)), sp.Integer(0)) for i in rows]
        used = free_symbols(e for _, e in matrix) | free_symbols(inputs)
        prologue = self._unpacked(used, "", "", "    ") + assignments(matrix, "w", "    ")

        def product(j: int) -> str:
            """Column j of Mⁿ⁺¹ = Mⁿ M from the columns b0 … b3 of Mⁿ."""
            terms = []
            for i in rows:
                if m[i, j] == 1:
                    terms.append(f"b{i}")
                elif m[i, j] != 0:
                    weight = repr(float(m[i, j])) if m[i, j].is_number else f"m{i}_{j}"
                    terms.append(f"{weight} * b{i}")
            return f"scale * ({' + '.join(terms)})"

        pushed = [i for i in rows if inputs[i] != 0]
        drive = " + ".join(f"push_{i} * b{i}" for i in pushed)
        prologue += assignments([(f"push_{i}", inputs[i]) for i in pushed], "v", "    ")
        lines = ["@compiled", "def flow(settings, memory, c, s, u, h, work):"]
        lines.append('    """Columns of the flow over h, and its derivatives, into work."""')
        lines += prologue
        lines += ["    highest = orders(h, work)"]
        lines += [f"    b{i} = gather(({', '.join('1.0' if j == i else '0.0' for j in rows)}))" for i in rows]
        lines += [f"    put(work, _POWERS + {4 * i}, b{i})" for i in rows]
        lines += ["    none = gather((0.0, 0.0, 0.0, 0.0))", f"    put(work, _POWERS + {4 * _STATES}, none)"]
        lines += ["    for n in range(highest):", "        scale = h / (n + 1.0)", f"        d = scale * ({drive})"]
        lines += [f"        a{j} = {product(j)}" for j in rows]
        lines += [f"        b{j} = a{j}" for j in rows]
        lines += ["        at = _POWERS + 20 * (n + 1)"]
        lines += [f"        put(work, at + {4 * j}, b{j})" for j in rows] + ["        put(work, at + 16, d)"]
        lines += ["    exponentials(work)", "    s0, s1, s2, s3 = s[0], s[1], s[2], s[3]"]
        lines += ["    now = take(s, 0, 4)", "    at = 0.0", "    for stage in range(_STAGES):"]
        lines += ["        where = _PASSES + _PASS * stage", "        put(work, where, now)"]
        lines += ["        e = _DRIFTS_AT + _DRIFT * LENGTH_OF[stage] + 3 * 20"]
        drifted = " + ".join(f"s{j} * take(work, e + {4 * j}, 4)" for j in rows)
        lines += [f"        now = take(work, e + 16, 4) + {drifted}"]
        lines += [f"        s{j} = lane(now, {j})" for j in rows]
        lines += [
            "        if stage < _STAGES - 1:",
            "            at += DRIFTS[stage]",
            "            weight = KICKS[stage] * h",
        ]
        lines += self._kick("            ")
        lines += ["    put(work, _COLUMNS, now)"]
        lines += self._adjoint()
        return "\n".join([FLOW_HEAD, "\n".join(lines)])

    def _kick(self, indent: str) -> list[str]:
        """One impulse: its derivatives into the stage's place, the states moved."""
        force = self.force
        by_states = [[sp.diff(force[a], s) for s in self.states] for a in range(2)]
        by_constants = [[sp.diff(force[a], k) for k in self.flowing] for a in range(2)]
        velocities = (1, 3)
        depends = any(by_states[a][v] != 0 for a in range(2) for v in velocities)
        signals = {s for s in self.signals if s in free_symbols(force)}
        lines = []
        if signals:
            lines += [f"{indent}signals = work[_SIGNALS : _SIGNALS + 2 * MAX_SIGNALS]"]
            if signals & self.in_time:
                lines += [f"{indent}line_values(settings, memory.time + at * h, signals)"]

        def evaluated(name: str, states: str) -> list[str]:
            pairs = [(f"{name}{a}", force[a]) for a in range(2)]
            pairs += [
                (f"{name}{a}_{j}", by_states[a][j]) for a in range(2) for j in range(_STATES) if by_states[a][j] != 0
            ]
            pairs += [
                (f"{name}{a}c{k}", by_constants[a][k])
                for a in range(2)
                for k in range(len(self.flowing))
                if by_constants[a][k] != 0
            ]
            used = free_symbols(e for _, e in pairs)
            return self._unpacked(used, states, "signals[{i}]", indent) + assignments(pairs, f"{name}w", indent)

        def entry(name: str, a: int, j: int) -> str:
            return f"{name}{a}_{j}" if by_states[a][j] != 0 else "0.0"

        def constant(name: str, a: int, k: int) -> str:
            return f"{name}{a}c{k}" if by_constants[a][k] != 0 else "0.0"

        last = "f"
        if depends:
            lines += evaluated("o", "s{i}")
            moving = " or ".join(f"o{a}_{v} != 0.0" for a in range(2) for v in velocities if by_states[a][v] != 0)
            lines += [f"{indent}half = 0.5 * weight if {moving} else 0.0"]
            lines += [f"{indent}s1 += half * o0", f"{indent}s3 += half * o1"]
            lines += evaluated("f", "s{i}")
            lines += [f"{indent}s1 -= half * o0", f"{indent}s3 -= half * o1"]
            for a in range(2):
                lines += [
                    f"{indent}slope_{a} = half * {entry('f', a, 1)}",
                    f"{indent}cross_{a} = half * {entry('f', a, 3)}",
                ]
            for a in range(2):
                for j in range(_STATES):
                    lines.append(
                        f"{indent}j{a}_{j} = {entry('f', a, j)} + slope_{a} * {entry('o', 0, j)}"
                        f" + cross_{a} * {entry('o', 1, j)}"
                    )
                for k in range(len(self.flowing)):
                    if any(by_constants[b][k] != 0 for b in range(2)):
                        lines.append(
                            f"{indent}c{a}_{k} = {constant('f', a, k)} + slope_{a} * {constant('o', 0, k)}"
                            f" + cross_{a} * {constant('o', 1, k)}"
                        )
        else:
            lines += evaluated("f", "s{i}")
            for a in range(2):
                lines += [f"{indent}j{a}_{j} = {entry('f', a, j)}" for j in range(_STATES)]
                for k in range(len(self.flowing)):
                    if any(by_constants[b][k] != 0 for b in range(2)):
                        lines.append(f"{indent}c{a}_{k} = {constant('f', a, k)}")
        lines += [f"{indent}s1 += weight * {last}0", f"{indent}s3 += weight * {last}1"]
        lines += [f"{indent}now = gather((s0, s1, s2, s3))"]
        for a in range(2):
            for j in range(_STATES):
                lines.append(f"{indent}work[where + {4 + 4 * a + j}] = weight * j{a}_{j}")
            for n, k in enumerate(self._kicked()):
                lines.append(f"{indent}work[where + {12 + a * len(self._kicked()) + n}] = weight * c{a}_{k}")
        return lines

    def _kicked(self) -> list[int]:
        """Flowing constants that the forces depend on."""
        return [k for k, symbol in enumerate(self.flowing) if symbol in free_symbols(self.force)]

    def _adjoint(self) -> list[str]:
        """Λ back from the end to the beginning, and what each constant does on the way."""
        rows = range(_STATES)
        base = [constant.symbol for constant in self.model.flow_constants]
        field = self.field
        lines = [f"    l{j} = gather(({', '.join('1.0' if i == j else '0.0' for i in rows)}))" for j in rows]
        lines += [f"    r{r}_{p} = none" for r in (1, 3) for p in rows]
        lines += [f"    k{k} = none" for k in self._kicked()]
        lines += ["    for back in range(_STAGES):", "        stage = _STAGES - 1 - back"]
        lines += ["        where = _PASSES + _PASS * stage", "        drift = _DRIFTS_AT + _DRIFT * LENGTH_OF[stage]"]
        lines += ["        if stage < _STAGES - 1:"]
        for n, k in enumerate(self._kicked()):
            one, other = 12 + n, 12 + len(self._kicked()) + n
            lines.append(f"            k{k} = k{k} + work[where + {one}] * l1 + work[where + {other}] * l3")
        for j in (0, 2):
            lines.append(f"            l{j} = l{j} + work[where + {4 + j}] * l1 + work[where + {8 + j}] * l3")
        lines += ["            n1 = l1 + work[where + 5] * l1 + work[where + 9] * l3"]
        lines += ["            l3 = l3 + work[where + 7] * l1 + work[where + 11] * l3", "            l1 = n1"]
        lines += [f"        s{j} = work[where + {j}]" for j in rows]
        lines += [
            "        for q in range(3):",
            "            e = drift + 20 * q",
            "            f = drift + 20 * (2 - q)",
        ]
        there = " + ".join(f"s{j} * take(work, e + {4 * j}, 4)" for j in rows)
        lines += [f"            there = take(work, e + 16, 4) + {there}"]
        lines += ["            weight = LENGTHS[LENGTH_OF[stage]] * h * WEIGHTS[q]"]
        for r in (1, 3):
            felt = " + ".join(f"work[f + {4 * r + j}] * l{j}" for j in rows)
            lines.append(f"            y{r} = weight * ({felt})")
        for r in (1, 3):
            lines += [f"            r{r}_{p} = r{r}_{p} + lane(there, {p}) * y{r}" for p in rows]
        lines += ["        e = drift + 60"]
        lines += [f"        n{j} = {' + '.join(f'work[e + {4 * j + i}] * l{i}' for i in rows)}" for j in rows]
        lines += [f"        l{j} = n{j}" for j in rows]
        lines += [f"    put(work, _COLUMNS + {4 * (1 + j)}, l{j})" for j in rows]
        for k, symbol in enumerate(self.flowing):
            terms = []
            if symbol in base:
                for r in rows:
                    pushed = sp.expand(sp.diff(field[r], symbol))
                    for p, state in enumerate(self.states):
                        weight = sp.diff(pushed, state)
                        if weight == 0:
                            continue
                        if r not in (1, 3) or not weight.free_symbols <= set(self.constants):
                            raise NotImplementedError(f"{self.model.name}: a flow that is not linear in its states")
                        terms.append(
                            f"({PRINTER.doprint(sp.Float(weight) if weight.is_number else weight)}) * r{r}_{p}"
                        )
                    left = pushed - sum(sp.diff(pushed, state) * state for state in self.states)
                    if sp.simplify(left) != 0:
                        raise NotImplementedError(f"{self.model.name}: {symbol} weights an input")
            if k in self._kicked():
                terms.append(f"k{k}")
            lines.append(f"    put(work, _COLUMNS + {4 * (1 + _STATES + k)}, {' + '.join(terms) or 'none'})")
        used = free_symbols(sp.diff(sp.diff(field[r], s), p) for r in rows for s in base for p in self.states)
        return [f"    {s} = c[{i}]" for i, s in enumerate(self.constants) if s in used] + lines
