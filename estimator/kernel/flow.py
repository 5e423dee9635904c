"""The flow over one step, with its sensitivities: exact for the linear part as a Taylor series, effects as impulses in
it, a late drive in the pieces that really acted.

Order and step are chosen so that the remainder is below rounding (`taylor_order`): one Runge–Kutta step at 20 samples a
cycle biases the stiffness by h⁴/60 = 1.6e-4 (tests/estimator/test_model.py).
"""

import math

import numpy as np

from estimator.effects.declaration import Source
from estimator.kernel.compiled import compiled, generated, inlined
from estimator.kernel.drifts import DRIFTS, KICKS, drift, drift_entries, drift_matrices, push_entries
from estimator.kernel.lanes import put, take
from estimator.kernel.layout import LONGEST_STEP, MAX_DELAY, MAX_SIGNALS, Floats, Record
from estimator.kernel.signals import directions, line_values, turns_over
from estimator.kernel.structures import FlowWork, Interval, Push
from estimator.kernel.taylor import taylor

_field_columns = generated().field_columns
_add_constants = generated().gyro_add_constants
_effect_force = generated().effect_force
_TURNOVER = (-3.0, 0.0, 3.0)
"""In v0: beyond, tanh is level to 0.5 %; between two of them seven impulses give its integral to 1e-4."""
_MOST_CUTS = 24
_STOP = Source.STOP.value
_CAUGHT = 1.0 - 1e-9
"""Of the half-width: what is as far from the foot as that moves it along."""


@compiled
def effect_forces(settings: Record, c: Floats, s: Floats, push: Push) -> None:
    """Sum of the effects' forces (axes,) at state s, drive and signals in push, and its derivatives (axes, states),
    (axes, constants).
    """
    force, by_states, by_constants, drive, signals, _ = push
    if settings.kinked == 1:
        directions(settings, s, signals)
    for k in range(settings.slip_count):
        signals[settings.slips[k, 0]] = push.slips[k, 0]
        signals[MAX_SIGNALS + settings.slips[k, 0]] = 0.0
    force[:] = 0.0
    by_states[:] = 0.0
    by_constants[:] = 0.0
    for e in range(settings.effect_count):
        number, first, signal = settings.effects[e]
        _effect_force(number, settings.model, c, s, drive, signals, first, signal, force, by_states, by_constants)


@compiled
def drive_at(u: Floats, at: float, out: Floats) -> None:
    """out (axes,) ← the polynomial u (axes, degree + 1) at normalised time `at`."""
    for axis in range(u.shape[0]):
        value = 0.0
        for n in range(u.shape[1] - 1, -1, -1):
            value = value * at + u[axis, n]
        out[axis] = value


@inlined
def by_velocity(settings: Record, by_states: Floats) -> bool:
    """Whether the effects' forces, by their derivatives, depend on a velocity."""
    depends = False
    for axis in range(settings.axes):
        for other in range(settings.axes):
            depends |= by_states[axis, 2 * other + 1] != 0.0
    return depends


@inlined
def kick(
    settings: Record, c: Floats, weight: float, columns: int, s: Floats, b: Floats, out: Floats, push: Push
) -> None:
    """Give the velocities in the columns of out the impulse weight × the effects' forces, sensitivities alike; s
    (states,) and b, of out's shape, are scratch.  columns is 1 or all of out's.

    A force that depends on the velocity changes during the impulse: it is taken from its middle.  There the velocities
    are v + ½ weight f, so that with f' = ∂f/∂v the derivatives of the whole are those in the middle, and ½ weight f'
    times those at the start.
    """
    force, by_states, by_constants, _, _, _ = push
    states = out.shape[0]
    for i in range(states):
        s[i] = out[i, 0]
    effect_forces(settings, c, s, push)
    moves = by_velocity(settings, by_states)
    half = 0.5 * weight
    if moves and columns > 1 and states == 4:
        keep_two(settings.sense_constants, b, push)
        s[1] += half * force[0]
        s[3] += half * force[1]
        effect_forces(settings, c, s, push)
        join_two(settings.sense_constants, half, b, push)
    elif moves:
        first = settings.sense_constants
        if columns > 1:
            b[0, 0], b[0, 1] = by_states[0, 0], by_states[0, 1]
            for j in range(2, columns - 1):
                b[0, j] = by_constants[0, first + j - 2]
        for axis in range(settings.axes):
            s[2 * axis + 1] += half * force[axis]
        effect_forces(settings, c, s, push)
        if columns > 1:
            slope = half * by_states[0, 1]
            for i in range(2):
                by_states[0, i] += slope * b[0, i]
            for j in range(2, columns - 1):
                by_constants[0, first + j - 2] += slope * b[0, j]
    if columns > 1 and settings.slip_count > 0:
        push_slips(settings, weight, moves, columns, out, push)
    if columns == 1:
        for axis in range(settings.axes):
            out[2 * axis + 1, 0] += weight * force[axis]
    elif states == 4:
        push_two(settings.sense_constants, weight, out, push)
    else:
        push_one(settings.sense_constants, weight, out, push)


@inlined
def keep_two(first: int, b: Floats, push: Push) -> None:
    """Rows of b, the derivatives in push of the forces on two axes: by the states, by the constants from `first` on."""
    by_states, by_constants = push.by_states, push.by_constants
    columns, own = b.shape[1], by_constants.shape[1]
    fours = columns - columns % 4
    for axis in range(2):
        put(b, axis * columns, take(by_states, 4 * axis, 4))
        for j in range(4, fours, 4):
            put(b, axis * columns + j, take(by_constants, axis * own + first + j - 4, 4))
        for j in range(fours, columns - 1):
            b[axis, j] = by_constants[axis, first + j - 4]


@inlined
def join_two(first: int, half: float, b: Floats, push: Push) -> None:
    """Add to the derivatives in push, which are those in the middle of an impulse, half ∂f/∂v times those at its start,
    which `keep_two` left in b.
    """
    by_states, by_constants = push.by_states, push.by_constants
    columns, own = b.shape[1], by_constants.shape[1]
    fours = columns - columns % 4
    for axis in range(2):
        slope, other = half * by_states[axis, 1], half * by_states[axis, 3]
        row = take(by_states, 4 * axis, 4)
        put(by_states, 4 * axis, row + slope * take(b, 0, 4) + other * take(b, columns, 4))
        for j in range(4, fours, 4):
            at = axis * own + first + j - 4
            moved = slope * take(b, j, 4) + other * take(b, columns + j, 4)
            put(by_constants, at, take(by_constants, at, 4) + moved)
        for j in range(fours, columns - 1):
            by_constants[axis, first + j - 4] += slope * b[0, j] + other * b[1, j]


@compiled
def push_slips(settings: Record, weight: float, moves: bool, columns: int, out: Floats, push: Push) -> None:
    """Add to the sensitivities of the velocities in out what weight × the forces make of those of the signals that
    depend on the way; moves: whether the forces depend on the velocity, and were taken from the middle of the impulse.
    """
    for k in range(settings.slip_count):
        row = 2 * settings.slips[k, 1] + 1
        share = weight * push.signals[MAX_SIGNALS + settings.slips[k, 0]]
        if moves:
            share *= 1.0 + 0.5 * weight * push.by_states[settings.slips[k, 1], row]
        for j in range(1, columns):
            out[row, j] += share * push.slips[k, j]


@compiled
def slid(z: float, way: float, reach: float) -> tuple[float, float, float, float]:
    """A slip z, counted along the motion, after a way along it (back where that is negative), and its derivatives by
    z, by the way and by the reach.

    Against the motion it moves as the mass does, along it by 1 − z/reach of that: exactly, whatever the speed was.
    """
    if way >= 0.0:
        if z + way <= 0.0:
            return z + way, 1.0, 1.0, 0.0
        straight = max(-z, 0.0)
        z += straight
        way -= straight
    elif z <= 0.0:
        return z + way, 1.0, 1.0, 0.0
    elif z < reach:
        left = (reach - z) / reach
        back = reach * math.log(left)
        if way < back:
            return way - back, 1.0 / left, 1.0, -(math.log(left) + (1.0 - left) / left)
    fade = math.exp(-way / reach)
    rest = (reach - z) * fade
    return reach - rest, fade, rest / reach, 1.0 - fade - rest * way / reach**2


@compiled
def caught(s: float, way: float, width: float) -> tuple[float, float, float, float]:
    """How far the mass is from what follows it with play, counted along the motion, after a way along it, and its
    derivatives by s, by the way and by the half-width.

    What is caught stays so as long as the mass moves on, and did before: an interval is cut where it is caught and
    where the mass turns, so that a way back within a piece does not let it go.
    """
    if s >= _CAUGHT * width:
        return width, 0.0, 0.0, 1.0
    s += way
    if s >= width:
        return width, 0.0, 0.0, 1.0
    if s <= -width:
        return -width, 0.0, 0.0, -1.0
    return s, 1.0, 1.0, 0.0


@compiled
def begin_ways(settings: Record, c: Floats, s: Floats, columns: int, slips: Floats) -> None:
    """Signals that depend on the way, and their sensitivities, at the first state s: what slips begins at 0, what is
    followed with play as if it had come from 0.
    """
    states = s.shape[0]
    for k in range(settings.slip_count):
        slips[k, :] = 0.0
        constant = settings.slips[k, 2]
        width = c[constant]
        if settings.slips[k, 3] != _STOP or not width > 0.0:
            continue
        x = s[2 * settings.slips[k, 1]]
        slips[k, 0] = min(max(x, -width), width)
        if columns > 1 and abs(x) < width:
            slips[k, 1 + 2 * settings.slips[k, 1]] = 1.0
        elif columns > 1:
            slips[k, 1 + states + constant - settings.sense_constants] = 1.0 if x > 0.0 else -1.0


@compiled
def slide(settings: Record, c: Floats, h: float, columns: int, before: Floats, out: Floats, slips: Floats) -> None:
    """Carry the signals that depend on the way, and their sensitivities, from the motion in the columns of before to
    that in out, h later; where the mass turns in between, to there first.
    """
    states = out.shape[0]
    for k in range(settings.slip_count):
        row = 2 * settings.slips[k, 1]
        constant = settings.slips[k, 2]
        reach = c[constant]
        if not reach > 0.0:
            slips[k, :] = 0.0
            continue
        first, last = before[row + 1, 0], out[row + 1, 0]
        turn = 1.0
        there = out[row, 0]
        if first * last < 0.0:
            turn = first / (first - last)
            there = before[row, 0] + 0.5 * first * turn * h
        own = 1 + states + constant - settings.sense_constants
        for piece in range(1 if turn == 1.0 else 2):
            if piece == 0:
                forth = first if turn < 1.0 else first + last
                way, begin, end = there - before[row, 0], 0.0, turn
            else:
                forth = last
                way, begin, end = out[row, 0] - there, turn, 1.0
            sign = 1.0 if forth > 0.0 else -1.0
            if settings.slips[k, 3] == _STOP:
                z, by_z, by_way, by_reach = caught(sign * slips[k, 0], sign * way, reach)
            else:
                z, by_z, by_way, by_reach = slid(sign * slips[k, 0], sign * way, reach)
            slips[k, 0] = sign * z
            for j in range(1, columns):
                moved = (end - begin) * (out[row, j] - before[row, j])
                slips[k, j] = by_z * slips[k, j] + by_way * moved
            if columns > 1:
                slips[k, own] += sign * by_reach


@inlined
def push_two(first: int, weight: float, out: Floats, push: Push) -> None:
    """The velocities of two axes in out ← what weight × the forces in push, linear in its columns, leave of them; of
    the constants from `first` on.
    """
    force, by_states, by_constants, _, _, _ = push
    columns = out.shape[1]
    own = by_constants.shape[1]
    vx = out[1, 0] + weight * force[0]
    vy = out[3, 0] + weight * force[1]
    x0, x1, x2, x3 = (
        weight * by_states[0, 0], weight * by_states[0, 1], weight * by_states[0, 2], weight * by_states[0, 3],
    )  # fmt: skip
    y0, y1, y2, y3 = (
        weight * by_states[1, 0], weight * by_states[1, 1], weight * by_states[1, 2], weight * by_states[1, 3],
    )  # fmt: skip
    fours = columns - columns % 4
    for j in range(0, fours, 4):
        o0, o1 = take(out, j, 4), take(out, columns + j, 4)
        o2, o3 = take(out, 2 * columns + j, 4), take(out, 3 * columns + j, 4)
        to_x = o1 + x0 * o0 + x1 * o1 + x2 * o2 + x3 * o3
        to_y = o3 + y0 * o0 + y1 * o1 + y2 * o2 + y3 * o3
        if j > 0:  # before, there are only the state and its own derivatives
            to_x = to_x + weight * take(by_constants, first + j - 5, 4)
            to_y = to_y + weight * take(by_constants, own + first + j - 5, 4)
        put(out, columns + j, to_x)
        put(out, 3 * columns + j, to_y)
    for j in range(fours, columns):
        o0, o1, o2, o3 = out[0, j], out[1, j], out[2, j], out[3, j]
        out[1, j] += x0 * o0 + x1 * o1 + x2 * o2 + x3 * o3 + weight * by_constants[0, first + j - 5]
        out[3, j] += y0 * o0 + y1 * o1 + y2 * o2 + y3 * o3 + weight * by_constants[1, first + j - 5]
    out[1, 0] = vx
    out[3, 0] = vy


@inlined
def push_one(first: int, weight: float, out: Floats, push: Push) -> None:
    """The same of a single axis."""
    force, by_states, by_constants, _, _, _ = push
    for j in range(1, out.shape[1]):
        pushed = by_states[0, 0] * out[0, j] + by_states[0, 1] * out[1, j]
        if j > 2:
            pushed += by_constants[0, first + j - 3]
        out[1, j] += weight * pushed
    out[1, 0] += weight * force[0]


@compiled
def part_of(u: Floats, start: float, length: float) -> Floats:
    """The polynomial u over [start, start + length] of its normalised time, in the normalised time of that part."""
    axes, terms = u.shape
    out = np.zeros((axes, terms))
    for axis in range(axes):
        for n in range(terms):
            binomial = 1.0
            for k in range(n, terms):
                out[axis, n] += u[axis, k] * binomial * start ** (k - n) * length**n
                binomial *= (k + 1.0) / (k + 1.0 - n)
    return out


@compiled
def advance_columns(settings: Record, interval: Interval, c: Floats, columns: int, work: FlowWork) -> None:
    """Advance the columns of out over the interval, effects included.

    The linear part is exact; effects, which are small, enter as impulses between exact drifts, the symmetric scheme of
    orders (8, 6, 4) of Blanes, Casas, Farrés, Laskar, Makazaga & Murua (Appl. Numer. Math. 68, 2013): an error of
    ε h⁸ + ε² h⁶ + ε³ h⁴ for an effect of relative size ε.
    """
    time, h, u = interval.time, interval.h, interval.u
    term, other, out, push = work.term, work.other, work.out, work.push  # not in the loop: taking an array counts it
    drive, signals, state = push.drive, push.signals, work.state
    if settings.pushes == 0:
        taylor(settings.model, c, u, h, settings.order, columns, term, out)
        return
    held = u.shape[1] == 1
    if columns > 1 and settings.axes == 2 and held and abs(h) <= LONGEST_STEP:
        advance_two(settings, interval, c, work)
        return
    at = 0.0
    for stage in range(len(DRIFTS)):
        length = DRIFTS[stage]
        part = u if held else part_of(u, at, length)
        if settings.slip_count > 0:
            other[:] = out
        taylor(settings.model, c, part, length * h, settings.order, columns, term, out)
        if settings.slip_count > 0:
            slide(settings, c, length * h, columns, other, out, push.slips)
        at += length
        if stage < len(KICKS):
            drive_at(u, at, drive)
            line_values(settings, time + at * h, signals)
            kick(settings, c, KICKS[stage] * h, columns, state, other, out, push)


@compiled
def advance_two(settings: Record, interval: Interval, c: Floats, work: FlowWork) -> None:
    """`advance_columns` of two axes under a drive that is held, with drifts by matrices that are the same for all
    columns.

    Each constant of the base model changes the field all along a drift: that integral is Gauss's rule of three points,
    and its error 6e-10 of the sensitivity at 20 samples a cycle, growing with the sixth power of the step.
    """
    time, h, u = interval.time, interval.h, interval.u
    other, out, push, drifts, entries, state = (
        work.other, work.out, work.push, work.drifts, work.entries, work.state,
    )  # fmt: skip
    drive, signals = push.drive, push.signals
    columns = out.shape[1]
    drift_matrices(c, u, h, work.powers, drifts)
    entries[:] = 0.0
    drive[0], drive[1] = u[0, 0], u[1, 0]
    at = 0.0
    for stage in range(len(DRIFTS)):
        which = min(stage, len(DRIFTS) - 1 - stage)
        if settings.slip_count > 0:
            other[:] = out
        drift_entries(which, DRIFTS[stage] * h, drifts, out, entries)
        drift(which, drifts, out)
        for i in range(4):
            out[i, 0] += drifts[which, 16 + i]
        if settings.slip_count > 0:  # what depends on the way depends on the constants, too
            _add_constants(c, entries, out)
            entries[:] = 0.0
            slide(settings, c, DRIFTS[stage] * h, columns, other, out, push.slips)
        at += DRIFTS[stage]
        if stage < len(KICKS):
            line_values(settings, time + at * h, signals)
            kick(settings, c, KICKS[stage] * h, columns, state, other, out, push)
            push_entries(KICKS[stage] * h, push, entries)
    _add_constants(c, entries, out)


@compiled
def along(before: float, slope_before: float, after: float, slope_after: float, t: float) -> float:
    """A cubic with those ends and slopes (per unit) at t in [0, 1]."""
    return (
        before * (1.0 + 2.0 * t) * (1.0 - t) ** 2
        + slope_before * t * (1.0 - t) ** 2
        + after * t * t * (3.0 - 2.0 * t)
        + slope_after * t * t * (t - 1.0)
    )


@compiled
def passing(before: float, slope_before: float, after: float, slope_after: float) -> float:
    """Where in [0, 1] a cubic with those ends and slopes (per unit) is zero; its ends differ in sign."""
    low, high = 0.0, 1.0
    for _ in range(20):  # where exactly the interval is cut hardly matters
        t = 0.5 * (low + high)
        if (along(before, slope_before, after, slope_after, t) > 0.0) == (before > 0.0):
            low = t
        else:
            high = t
    return 0.5 * (low + high)


@compiled
def insert_sorted(values: Floats, count: int, value: float) -> int:
    """Put value among the first `count` of values, which ascend; returns how many there are now, no more than fit."""
    if count == values.shape[0]:
        return count
    place = count
    while place > 0 and values[place - 1] > value:
        values[place] = values[place - 1]
        place -= 1
    values[place] = value
    return count + 1


@compiled
def turnovers(settings: Record, interval: Interval, c: Floats, work: FlowWork, cuts: Floats) -> int:
    """cuts ← where in the interval, in order, the motion in out[:, 0] enters, crosses and leaves what friction turns
    over in, and turns where a force depends on the way; returns how many there are.

    Of the motion without effects: it is where to cut, and not what acts.
    """
    h, u, out = interval.h, interval.u, work.out
    states = out.shape[0]
    end = np.empty((states, 1))
    for i in range(states):
        end[i, 0] = out[i, 0]
    taylor(settings.model, c, u, h, settings.order, 1, work.term, end)
    carried = settings.effects[settings.effect_count, 2] if settings.candidate_count > 0 else settings.signal_count
    slopes = np.empty((2, states))
    sloped = False
    count = 0
    for i in range(carried):
        axis = settings.signals[i, 1]
        if not turns_over(settings, i):
            continue
        row = 2 * axis + 1
        for level in _TURNOVER:
            speed = level * settings.signal_parameters[i, 0]
            before, after = out[row, 0] - speed, end[row, 0] - speed
            if before * after >= 0.0:
                continue
            if not sloped:
                ends_slopes(settings, c, u, end, work, slopes)
                sloped = True
            at = passing(before, slopes[0, row] * h, after, slopes[1, row] * h)
            count = insert_sorted(cuts, count, at)
    for k in range(settings.slip_count):
        row = 2 * settings.slips[k, 1] + 1
        if out[row, 0] * end[row, 0] < 0.0:
            if not sloped:
                ends_slopes(settings, c, u, end, work, slopes)
                sloped = True
            at = passing(out[row, 0], slopes[0, row] * h, end[row, 0], slopes[1, row] * h)
            count = insert_sorted(cuts, count, at)
        else:
            at = 1.0
        if settings.slips[k, 3] == _STOP and h > 0.0:
            count = catches(work.push.slips[k, 0], c[settings.slips[k, 2]], row - 1, h, out, end, at, cuts, count)
    return count


@compiled
def catches(
    s: float, width: float, row: int, h: float, begin: Floats, end: Floats, turn: float, cuts: Floats, count: int
) -> int:
    """Add to cuts where the mass, s from what follows it with play, catches it, on either side of its turn (1 without
    one); begin and end have its displacement in a row and its velocity in the next.
    """
    x0, v0, x1, v1 = begin[row, 0], begin[row + 1, 0] * h, end[row, 0], end[row + 1, 0] * h
    at, x = 0.0, x0
    for piece in range(2):
        until = turn if piece == 0 else 1.0
        if not until > at:
            continue
        there = along(x0, v0, x1, v1, until)
        sign = 1.0 if there > x else -1.0
        left = width - sign * s
        if left > (1.0 - _CAUGHT) * width and sign * (there - x) > left:
            low, high = at, until
            for _ in range(40):
                middle = 0.5 * (low + high)
                if sign * (along(x0, v0, x1, v1, middle) - x) < left:
                    low = middle
                else:
                    high = middle
            count = insert_sorted(cuts, count, 0.5 * (low + high))
        s = sign * min(sign * s + sign * (there - x), width)
        at, x = until, there
    return count


@compiled
def ends_slopes(settings: Record, c: Floats, u: Floats, end: Floats, work: FlowWork, slopes: Floats) -> None:
    """slopes (2, states) ← time derivatives without effects at both ends of an interval, its states there in column 0
    of work.out and of end.
    """
    a, b, start = work.term, work.other, work.out
    drive = np.empty(u.shape[0])
    for place in range(2):
        for i in range(start.shape[0]):
            a[i, 0] = start[i, 0] if place == 0 else end[i, 0]
        drive_at(u, float(place), drive)
        _field_columns(settings.model, c, a, drive, b, 1)
        for i in range(start.shape[0]):
            slopes[place, i] = b[i, 0]


@compiled
def advance(settings: Record, interval: Interval, c: Floats, columns: int, work: FlowWork) -> None:
    """`advance_columns`, in pieces where a velocity passes what friction turns over in: within each, the force is
    smooth beside the piece.
    """
    count = 0
    cuts = np.empty(_MOST_CUTS)
    if settings.kinked == 1:
        count = turnovers(settings, interval, c, work, cuts)
    if count == 0:
        advance_columns(settings, interval, c, columns, work)
        return
    time, h = interval.time, interval.h
    at = 0.0
    for piece in range(count + 1):
        until = cuts[piece] if piece < count else 1.0
        if until > at:
            part = Interval(time + at * h, (until - at) * h, part_of(interval.u, at, until - at))
            advance_columns(settings, part, c, columns, work)
            at = until


@compiled
def late_polynomial(u: Floats, past: Floats, axis: int, delay: float, start: float, length: float, out: Floats) -> None:
    """out (degree + 1,) ← drive of one axis, late by `delay` intervals, over [start, start + length] of this interval,
    in the normalised time of that part; the part must not reach over a boundary of the recorded intervals.

    past (intervals, axes, terms) holds the drives of the intervals before, newest first.
    """
    begin = start - delay
    back = min(int(np.ceil(-begin - 1e-12)), past.shape[0]) if begin < 0.0 else 0
    terms = out.shape[0]
    if back == 0:
        shifted = part_of(u, begin, length)
    else:
        shifted = part_of(past[back - 1, : u.shape[0], :terms], begin + back, length)
    for n in range(terms):
        out[n] = shifted[axis, n]


@compiled
def late_parts(settings: Record, c: Floats, h: float) -> tuple[float, float, float, float]:
    """Delay of each axis in intervals, within what is kept, and where in an interval the recorded drives change."""
    longest = MAX_DELAY - 1.0
    first = max(min(c[settings.drive_delay] / h, longest), 0.0)  # in this order a NaN becomes a number
    second = first
    if settings.axes == 2:
        second = max(min(c[settings.drive_delay + 1] / h, longest), 0.0)
    return first, second, first - np.floor(first), second - np.floor(second)


@compiled
def flow_late(settings: Record, interval: Interval, past: Floats, c: Floats, columns: int, work: FlowWork) -> None:
    """`advance` under a drive that is late by the constants at settings.drive_delay, sensitivities to them
    included.

    A shift of the input u(t − τ) moves what it forces by −(B u(h − τ) − Φ B u(−τ) + M x_forced): the integral of
    −Φ B u̇ by parts, jumps and all.
    """
    time, h, u = interval.time, interval.h, interval.u
    a, b, out = work.term, work.other, work.out
    delays = late_parts(settings, c, h)
    terms = u.shape[1]
    axes = settings.axes
    cuts = np.array([0.0, min(delays[2], delays[3]), max(delays[2], delays[3]), 1.0])
    part = np.zeros((axes, terms))
    states = out.shape[0]
    forced = np.zeros((axes, states, 1))
    for piece in range(3):
        length = cuts[piece + 1] - cuts[piece]
        if length <= 0.0:
            continue
        for axis in range(axes):
            late_polynomial(u, past, axis, delays[axis], cuts[piece], length, part[axis])
        advance(settings, Interval(time + cuts[piece] * h, length * h, part), c, columns, work)
        if columns > 1:
            for axis in range(axes):
                alone = np.zeros((axes, terms))
                alone[axis] = part[axis]
                taylor(settings.model, c, alone, length * h, settings.order, 1, a, forced[axis])
    ends = np.zeros((axes, 2))  # the late drive just before this interval and at its end
    for axis in range(axes):
        late_polynomial(u, past, axis, delays[axis], 1.0 - 1e-9, 1e-9, part[axis])
        ends[axis, 1] = part[axis].sum()
        late_polynomial(u, past, axis, delays[axis] + 1.0, 1.0 - 1e-9, 1e-9, part[axis])
        ends[axis, 0] = part[axis].sum()
    for axis in range(axes):
        row = 2 * axis + 1
        early = min(c[settings.drive_delay + axis], 0.0)  # a delay below zero, by its derivative at zero
        if columns > 1:
            column = 1 + states + settings.drive_delay + axis - settings.sense_constants
            a[:, 0] = forced[axis, :, 0]
            _field_columns(settings.model, c, a, np.zeros(axes), b, 1)
            for i in range(states):
                out[i, column] += out[i, 1 + row] * ends[axis, 0] - b[i, 0]
            out[row, column] -= ends[axis, 1]
            for i in range(states):
                out[i, 0] += early * out[i, column]
        elif early < 0.0:
            out[row, 0] += early * (ends[axis, 0] - ends[axis, 1])


@compiled
def flow(
    settings: Record, interval: Interval, past: Floats, c: Floats, s: Floats, columns: int, work: FlowWork
) -> None:
    """Advance s over the interval, into work.out.

    Its first column is the new state; with columns > 1 the others are ∂/∂s and ∂/∂(flow and effect constants).  past
    holds the drives of earlier intervals for a drive that is late.
    """
    out = work.out
    states = s.shape[0]
    for i in range(states):
        for j in range(columns):
            out[i, j] = 0.0
        out[i, 0] = s[i]
        if columns > 1:
            out[i, 1 + i] = 1.0
    for k in range(settings.slip_count):
        work.push.slips[k, 1:] = 0.0
    if settings.drive_delay >= 0:
        flow_late(settings, interval, past, c, columns, work)
    else:
        advance(settings, interval, c, columns, work)


@compiled
def sensed_before(
    settings: Record, interval: Interval, past: Floats, c: Floats, s: Floats, axis: int, work: FlowWork
) -> None:
    """Columns work.out of the state at the delay of one sense axis (constants at settings.sense_delay) before state s,
    which is that of interval.time.

    The interval's drive is that of the one that ends at s; its force is taken as it was recorded, late or not.
    """
    time, h, u = interval.time, interval.h, interval.u
    out = work.out
    states = s.shape[0]
    for i in range(states):
        for j in range(out.shape[1]):
            out[i, j] = 0.0
        out[i, 0] = s[i]
        out[i, 1 + i] = 1.0
    slips = work.push.slips
    kept = slips[:, 0].copy()
    slips[:, 1:] = 0.0
    left = min(c[settings.sense_delay + axis] / h, MAX_DELAY - 1.0)
    if not np.isfinite(left):
        left = 0.0
    back = 0
    while True:
        length = min(left, 1.0) if left > 0.0 else left
        if back == 0:
            reversed_drive = part_of(u, 1.0, -length)
        else:
            reversed_drive = part_of(past[back - 1, : u.shape[0], : u.shape[1]], 1.0, -length)
        advance(settings, Interval(time, -length * h, reversed_drive), c, out.shape[1], work)
        time -= length * h
        left -= length
        back += 1
        if not left > 0.0:
            slips[:, 0] = kept
            return
