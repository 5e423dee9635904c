"""From one model and a set of effects to the source of a filter step of its own: the specialised step.

The same filter as `estimator.kernel.observer`, written for one number of constants, one set of effects and the sparsity
of both: F is [Fs Fc; 0 I] with four rows that are not the identity's, a row of the measurement has the entries it has,
and each measurement, of one axis or of a constant against its guess, is taken in on its own, which for uncorrelated
noise is the same as both at once.  Covariances are in vector registers.  The observer of 13 states without effects
(`estimator.kernel.plain`) is the instance with no effect.

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
from estimator.kernel.layout import MAX_SIGNALS
from estimator.model.codegen import PRINTER, assignments, free_symbols
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
        return Template(_TEXT).substitute({name: str(value) for name, value in fields.items()})

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
                f"def measure_{axis}(innovation, noise, x, p, c, work):",
                f'    """What axis {axis} shows, taken in; returns (ν/√S, what a unit of that moves the other by)."""',
                f"    ps = {states_of('p')}",
                f"    cs = {states_of('c')}",
                f"    pc = {constants_of('p')}",
                f"    cc = {constants_of('c')}",
                f"    sp = noise + {variance_of('ps', 'pc')}",
                f"    sc = noise + {variance_of('cs', 'cc')}",
                f"    seen = {seen}",
                "    whitened = take_in(innovation, sp, sc, seen, ps, pc, cs, cc, x, p, c, work)",
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
        return "\n".join([_FLOW_HEAD, "\n".join(lines)])

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


_FLOW_HEAD = '''_STAGES = 8
LENGTHS = DRIFTS[:4]
LENGTH_OF = (0, 1, 2, 3, 3, 2, 1, 0)
_ROOT = math.sqrt(0.6)
NODES = (0.5 - 0.5 * _ROOT, 0.5, 0.5 + 0.5 * _ROOT, 1.0)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
SHARES = tuple(length * node for length in LENGTHS for node in NODES)


@compiled
def orders(h, work):
    """Terms of the series of each of the 16 matrices, into work, found anew where h is another; returns the most."""
    if work[_ORDERS + 16] != h:
        work[_ORDERS + 16] = h
        most = 2
        for m in range(16):
            own = 2
            while own < _MOST and abs(SHARES[m] * h) >= LONGEST[own]:
                own += 1
            work[_ORDERS + m] = own
            most = max(most, own)
        work[_ORDERS + 17] = most
    return int(work[_ORDERS + 17])


@inlined
def exponentials(work):
    """E(τ) and what the drive does up to τ, columns of four, for the points of the rule and the end of each length."""
    for m in range(16):
        share = SHARES[m]
        power = 1.0
        a0, a1, a2 = take(work, _POWERS, 4), take(work, _POWERS + 4, 4), take(work, _POWERS + 8, 4)
        a3, a4 = take(work, _POWERS + 12, 4), take(work, _POWERS + 16, 4)
        for n in range(1, int(work[_ORDERS + m]) + 1):
            power *= share
            at = _POWERS + 20 * n
            a0 = a0 + power * take(work, at, 4)
            a1 = a1 + power * take(work, at + 4, 4)
            a2 = a2 + power * take(work, at + 8, 4)
            a3 = a3 + power * take(work, at + 12, 4)
            a4 = a4 + power * take(work, at + 16, 4)
        to = _DRIFTS_AT + 20 * m
        put(work, to, a0)
        put(work, to + 4, a1)
        put(work, to + 8, a2)
        put(work, to + 12, a3)
        put(work, to + 16, a4)


'''

_TEXT = '''"""A filter step, generated from a model and its effects (estimator.model.step); not to be edited."""

import math

import numpy as np

from estimator.kernel.angle import note_forced_rotation, read_angle
from estimator.kernel.angle_error import note_gradient, refer_angle
from estimator.kernel.compiled import compiled, generated, inlined
from estimator.kernel.controller import advance_queue, command, virtual_rate
from estimator.kernel.flow import DRIFTS, KICKS, LONGEST
from estimator.kernel.lanes import gather, lane, put, put_columns, take
from estimator.kernel.layout import MAX_SIGNALS, RATE
from estimator.kernel.observer import ATTENTION, fading_factor, workspace
from estimator.kernel.signals import advance_signals, line_values, signal_values

_${model}_flow_lanes = generated().${model}_flow_lanes
_jump = generated().${model}_jump

STATES = 4
CONSTANTS = ${constants}
SIZE = STATES + CONSTANTS
_W = ${width}  # width of a row
_FLOW = ${columns}  # columns of the flow: state, by the states, by the flowing constants
_MOST = 20
# Places in the workspace.
_COLUMNS = STATES * _FLOW
_T = 2 * _COLUMNS  # the states' rows of the covariance to be
_MIRROR = _T + STATES * _W
_NOISE = _MIRROR + 4 * STATES
_Y = _NOISE + 4 * STATES
_V = _Y + _W
_B = _V + _W
_KICK = _B + _W
_UNIT = _KICK + 4
_ANGLE = _UNIT + CONSTANTS * (_W - STATES)  # covariance of the angle with states and constants
_ANGLE_VARIANCE = _ANGLE + _W
_GRADIENT = _ANGLE_VARIANCE + 4  # of the pattern angle
_H = _GRADIENT + 4  # derivatives of what is measured
_SIGNALS = _H + 2 * SIZE
_POWERS = _SIGNALS + 2 * MAX_SIGNALS  # (M h)^n / n! and what the drive does, columns of four
_DRIFT = 80  # four matrices with four columns and the drive's
_DRIFTS_AT = _POWERS + 20 * (_MOST + 1)
_PASS = 12 + 2 * CONSTANTS  # the states, an impulse's derivatives by them and by the constants
_PASSES = _DRIFTS_AT + 4 * _DRIFT
_ORDERS = _PASSES + 8 * _PASS
_END = _ORDERS + 20


${flow}


@compiled
def unpacked(x, p, c, memory, wanted):
    """State vector, covariances and scratch of the functions below, flat; empty unless wanted."""
    if not wanted:
        nothing = np.zeros(0)
        return nothing, nothing, nothing, nothing
    flat_x, flat_p, flat_c = np.zeros(_W), np.zeros(SIZE * _W), np.zeros(SIZE * _W)
    for i in range(SIZE):
        flat_x[i] = x[i]
        for j in range(SIZE):
            flat_p[_W * i + j] = p[i, j]
            flat_c[_W * i + j] = c[i, j]
    work = np.zeros(_END)
    for k in range(CONSTANTS):
        work[_UNIT + (_W - STATES + 1) * k] = 1.0
    for i in range(SIZE):
        work[_ANGLE + i] = memory.angle_cross[i]
    work[_ANGLE_VARIANCE] = memory.angle_variance
    return flat_x, flat_p, flat_c, work


@compiled
def restore(flat_x, flat_p, flat_c, work, x, p, c, memory):
    """State vector, covariances and those of the angle out of the flat ones and the scratch."""
    memory.angle_variance = work[_ANGLE_VARIANCE]
    for i in range(SIZE):
        memory.angle_cross[i] = work[_ANGLE + i]
    for i in range(SIZE):
        x[i] = flat_x[i]
        for j in range(i, SIZE):
            p[i, j] = flat_p[_W * i + j]
            p[j, i] = flat_p[_W * i + j]
            c[i, j] = flat_c[_W * i + j]
            c[j, i] = flat_c[_W * i + j]


@compiled
def propagate(p, work, factor):
    """p <- factor F p F' plus the states' noise in work, by the flow in work.

    With T = [Fs Fc] p the constants' part of the states' rows is T's own, and their square part D + D' with
    D = [Fs Pss / 2, Fs Psc + Fc Pcc / 2] [Fs Fc]', which needs nothing from below the diagonal.
    """
    for i in range(STATES):
${apart}
        put(work, _T + _W * i, d)
        put(work, _T + _W * i + 4, a + b)
    put_columns(
        work, _MIRROR, take(work, _T, 4), take(work, _T + _W, 4), take(work, _T + 2 * _W, 4), take(work, _T + 3 * _W, 4)
    )
    for i in range(STATES):
        square = take(work, _T + _W * i, 4) + take(work, _MIRROR + 4 * i, 4)
        put(p, _W * i, factor * square + take(work, _NOISE + 4 * i, 4))
        put(p, _W * i + 4, factor * take(work, _T + _W * i + 4, ${lanes}))
    if factor != 1.0:
        for i in range(STATES, SIZE):
            put(p, _W * i + 4, factor * take(p, _W * i + 4, ${lanes}))


@inlined
def force_noise(settings, h, work):
    """Covariance of what force noise does to the states over h, into work."""
    for axis in range(2):
        q = settings.force_noise[axis]
        at = _NOISE + 10 * axis
        work[at] = q * h * h * h / 3.0
        work[at + 1] = q * h * h / 2.0
        work[at + 4] = q * h * h / 2.0
        work[at + 5] = q * h


@compiled
def walk_constant(p, work, k, q):
    """Random walk of constant k, variance q; what its steps do to the states stands in work."""
    p[(_W + 1) * (STATES + k)] += q
    kick = take(work, _KICK, 4)
    unit = take(work, _UNIT + (_W - STATES) * k, ${lanes})
    for i in range(STATES):
        w = q * work[_KICK + i]
        if w != 0.0:
            put(p, _W * i, take(p, _W * i, 4) + w * kick)
            put(p, _W * i + 4, take(p, _W * i + 4, ${lanes}) + w * unit)


@inlined
def predict_angle(c, h, work):
    """`estimator.kernel.angle_error.predict_angle` and `move_angle`, by the flow in work."""
    rate = STATES + RATE
    work[_ANGLE_VARIANCE] += h * (2.0 * work[_ANGLE + rate] + h * c[(_W + 1) * rate])
    along = gather((c[rate], c[_W + rate], c[2 * _W + rate], c[3 * _W + rate]))
    s = take(work, _ANGLE, 4) + h * along
    k = take(work, _ANGLE + 4, ${lanes}) + h * take(c, _W * rate + 4, ${lanes})
    put(work, _ANGLE + 4, k)
    put(work, _ANGLE, ${angle})


@inlined
def predict(settings, memory, walk, x, p, c, u, h, work):
    """Advance state and covariances over h with the drive u (2, degree + 1) that acted."""
${move}
    force_noise(settings, h, work)
    predict_angle(c, h, work)
    propagate(c, work, 1.0)
    propagate(p, work, fading_factor(settings, memory))
    kick = work[_KICK:_UNIT]
    for k in range(CONSTANTS):
        if walk[k] != 0.0:
            _jump(x, k, kick)
            walk_constant(c, work, k, walk[k] * h)
            walk_constant(p, work, k, walk[k] * h)


@inlined
def exchange(p, plus, minus, work):
    """p <- p + b b' - v v', vectors in work."""
    bs = take(work, plus, 4)
    bc = take(work, plus + 4, ${lanes})
    vs = take(work, minus, 4)
    vc = take(work, minus + 4, ${lanes})
    for i in range(STATES):
        put(p, _W * i, take(p, _W * i, 4) - work[minus + i] * vs + work[plus + i] * bs)
    for i in range(SIZE):
        put(p, _W * i + 4, take(p, _W * i + 4, ${lanes}) - work[minus + i] * vc + work[plus + i] * bc)


@inlined
def remove(p, minus, work):
    """p <- p - v v', the vector in work."""
    vs = take(work, minus, 4)
    vc = take(work, minus + 4, ${lanes})
    for i in range(STATES):
        put(p, _W * i, take(p, _W * i, 4) - work[minus + i] * vs)
    for i in range(SIZE):
        put(p, _W * i + 4, take(p, _W * i + 4, ${lanes}) - work[minus + i] * vc)


@inlined
def take_in(innovation, sp, sc, seen, ps, pc, cs, cc, x, p, c, work):
    """A measurement with P h = [ps pc], C h = [cs cc], its variances sp and sc by both and its covariance `seen` with
    the angle, taken in; returns the innovation over sqrt S.

    With S = h'Ph + R and y = Ph / sqrt S the gain is y / sqrt S and P <- P - y y'.  With v = Ch / sqrt Sc, Joseph's
    form (I - KH) C (I - KH)' + K R K' is C - v v' + (sqrt Sc K - v)(sqrt Sc K - v)'.
    """
    root = math.sqrt(sp)
    whitened = innovation / root
    ys = (1.0 / root) * ps
    yc = (1.0 / root) * pc
    put(x, 0, take(x, 0, 4) + whitened * ys)
    put(x, 4, take(x, 4, ${lanes}) + whitened * yc)
    put(work, _Y, ys)
    put(work, _Y + 4, yc)
    remove(p, _Y, work)
    actual = math.sqrt(sc)
    vs = (1.0 / actual) * cs
    vc = (1.0 / actual) * cc
    put(work, _V, vs)
    put(work, _V + 4, vc)
    put(work, _B, (actual / root) * ys - vs)
    put(work, _B + 4, (actual / root) * yc - vc)
    turn = 0.0  # of the angle: its gain (`angle_error.recall_angle`)
    for i in range(4):
        turn -= work[_GRADIENT + i] * work[_Y + i] / root
    work[_ANGLE_VARIANCE] += (sc * turn - 2.0 * seen) * turn
    share = (sc * turn - seen) / root
    put(work, _ANGLE, take(work, _ANGLE, 4) + share * ys - turn * cs)
    put(work, _ANGLE + 4, take(work, _ANGLE + 4, ${lanes}) + share * yc - turn * cc)
    exchange(c, _B, _V, work)
    return whitened


${measures}


@compiled
def recall(k, innovation, noise, x, p, c, work):
    """Take in a measurement of constant k."""
    row = _W * (STATES + k)
    column = STATES + k
    ps = gather((p[column], p[_W + column], p[2 * _W + column], p[3 * _W + column]))
    cs = gather((c[column], c[_W + column], c[2 * _W + column], c[3 * _W + column]))
    pc = take(p, row + 4, ${lanes})
    cc = take(c, row + 4, ${lanes})
    sp = p[row + column] + noise
    sc = c[row + column] + noise
    take_in(innovation, sp, sc, work[_ANGLE + column], ps, pc, cs, cc, x, p, c, work)


@inlined
def correct(settings, memory, prior, spread, guess, x, p, covariance, z, u, h, work, row):
    """Update state and covariances with z (NaN: no measurement); innovation and its variance go to the output row."""
${sense}
    measured = False
${innovations}
    if not measured:
        return
    surprise = 0.0
    moved = 0.0
    if np.isfinite(z[0]):
        white, other = measure_0(row.nu[0], settings.noise[0], x, p, covariance, work)
        moved = white * other
        surprise += 0.5 * white * white
    if np.isfinite(z[1]):
        white, other = measure_1(row.nu[1] - moved, settings.noise[1], x, p, covariance, work)
        surprise += 0.5 * white * white
    memory.surprise += (surprise - memory.surprise) * ATTENTION
    memory.cursor = (memory.cursor + 1) % CONSTANTS
    k = memory.cursor
    if prior[k] > 0.0:  # else known exactly from the start: nothing is forgotten of it
        recall(k, guess[k] - x[STATES + k], prior[k], x, p, covariance, work)
    for k in range(CONSTANTS):
        variance = p[(_W + 1) * (STATES + k)]
        if spread[k] > 0.0 and variance > spread[k]:
            noise = variance * spread[k] / (variance - spread[k])
            recall(k, guess[k] - x[STATES + k], noise, x, p, covariance, work)


@inlined
def advance(settings, memory, walk, prior, spread, guess, x, p, c, z, u, h, work, row):
    """`estimator.kernel.block.advance` with flat covariances and a state vector that is filled up."""
    predict(settings, memory, walk, x, p, c, u, h, work)
    note_forced_rotation(settings, memory, x, h)
    note_gradient(settings, memory, x)
    for i in range(4):
        work[_GRADIENT + i] = memory.gradient[i]
    correct(settings, memory, prior, spread, guess, x, p, c, z, u, h, work, row)
    memory.time += h
    read_angle(settings, memory, x, h, row)
    if refer_angle(settings, memory):
        for i in range(_ANGLE, _ANGLE_VARIANCE + 1):
            work[i] = 0.0
    row.angle_variance = work[_ANGLE_VARIANCE] / settings.angular_gain**2


@compiled
def observe_block(
    settings_record, walk, prior, spread, guess, x, p, c, memory_record, z, u, h, temperature, rows, states_out,
    deviations_out, every,
):
    """`estimator.kernel.block.observe_block` of this step."""
    settings = settings_record[0]
    memory = memory_record[0]
    flat_x, flat_p, flat_c, work = unpacked(x, p, c, memory, True)
    written = 0
    for m in range(z.shape[0]):
        if temperature.shape[0] > 0:
            memory.temperature = temperature[m]
        driven = u[m, 0, 0] != 0.0 or u[m, 1, 0] != 0.0
        memory.virtual_applied = virtual_rate(settings, memory.time) if settings.control == 1 and driven else 0.0
        advance(settings, memory, walk, prior, spread, guess, flat_x, flat_p, flat_c, z[m], u[m], h[m], work, rows[m])
        if m % every == every - 1:
            restore(flat_x, flat_p, flat_c, work, x, p, c, memory)
            for i in range(SIZE):
                states_out[written, i] = x[i]
                deviations_out[written, i] = math.sqrt(c[i, i])
            written += 1
    restore(flat_x, flat_p, flat_c, work, x, p, c, memory)
    return written


@compiled
def tick(settings_record, walk, prior, spread, guess, x, p, c, memory_record, vx, vy, ux, uy, rows, codes):
    """`estimator.kernel.block.tick` of this step."""
    settings = settings_record[0]
    memory = memory_record[0]
    drive = np.zeros((2, 1))
    drive[0, 0] = ux * settings.quantum
    drive[1, 0] = uy * settings.quantum
    z = np.zeros(2)
    z[0] = vx * settings.sense_scale[0]
    z[1] = vy * settings.sense_scale[1]
    advance_queue(settings, memory, drive[:, 0])
    flat_x, flat_p, flat_c, work = unpacked(x, p, c, memory, True)
    advance(settings, memory, walk, prior, spread, guess, flat_x, flat_p, flat_c, z, drive, settings.h, work, rows[0])
    restore(flat_x, flat_p, flat_c, work, x, p, c, memory)
    command(settings, memory, x, workspace(settings, p.shape[0], x.shape[0]), codes)
'''
