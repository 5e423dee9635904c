"""The pieces of the flow, each beside NumPy's polynomials, SciPy's solutions, or its own mapping's differences."""

import math

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import expm
from scipy.optimize import brentq

from estimator.core.layout import MAX_DELAY, MAX_SIGNALS
from estimator.core.taylor import taylor_order
from estimator.effects.declaration import Source
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings
from tests.estimator.flow_pieces import (
    Cuts,
    FlowWork,
    Interval,
    Push,
    along,
    begin_ways,
    catches,
    drift,
    drift_lengths,
    drift_matrices,
    drive_at,
    find_slopes,
    insert_sorted,
    kick,
    late_by,
    late_polynomial,
    part_of,
    passing,
    push_entries,
    push_one,
    push_slips,
    push_two,
    slid,
    slide,
    turnovers,
)
from tests.estimator.gyro_loop import Truth, free_motion

LENGTHS, OF_A_LENGTH = 4, 80

RANDOM = np.random.default_rng(8)
DRIVE = np.array([[0.4, -0.3, 0.2, 0.5], [-0.2, 0.6, 0.1, -0.4]])


def one_axis(**effects: dict[str, float]) -> Observer:
    device = Device(4000.0, (1.6e6,), (1.0,), 1e-4, (-890.0,), (1e-4,))
    return Observer(device, ObserverSettings(gain=Gain.EKF, effects=effects))


def two_axes(**effects: dict[str, float]) -> Observer:
    return Observer(Truth().device(), ObserverSettings(gain=Gain.EKF, effects=effects))


def test_a_drive_is_its_polynomial_and_so_is_any_part_of_it() -> None:
    found = np.zeros(2)
    for at in (0.0, 0.3, 1.0):
        drive_at(DRIVE, at, found)
        np.testing.assert_allclose(found, [Polynomial(row)(at) for row in DRIVE], rtol=1e-13)
    for start, length in ((0.0, 1.0), (0.2, 0.5), (1.0, -0.7)):
        expected = [Polynomial(row)(Polynomial([start, length])).coef for row in DRIVE]
        np.testing.assert_allclose(part_of(DRIVE, start, length), expected, rtol=1e-12, atol=1e-14)


def test_between_two_ends_goes_the_cubic_of_hermite_and_it_is_zero_where_it_is() -> None:
    before, slope_before, after, slope_after = 0.7, -2.0, -0.4, 0.9
    cubic = CubicHermiteSpline([0.0, 1.0], [before, after], [slope_before, slope_after])
    for t in (0.0, 0.2, 0.7, 1.0):
        assert along(before, slope_before, after, slope_after, t) == pytest.approx(float(cubic(t)), abs=1e-14)
    root = brentq(cubic, 0.0, 1.0)
    assert passing(before, slope_before, after, slope_after) == pytest.approx(root, abs=1e-6)
    assert passing(-before, -slope_before, -after, -slope_after) == pytest.approx(root, abs=1e-6)


def test_cuts_stand_in_order_and_no_more_than_fit() -> None:
    cuts, expected = Cuts(), []
    for value in RANDOM.permutation(24) / 24.0:
        insert_sorted(cuts, float(value))
        expected = sorted([*expected, value])
        assert cuts.at[: cuts.count].tolist() == expected
    insert_sorted(cuts, 0.5)
    assert cuts.at.tolist() == expected


@pytest.mark.parametrize("h", [0.01, 0.3, 0.9, 2.0])
def test_the_order_is_the_least_whose_remainder_is_below_rounding(h: float) -> None:
    def remainder(order: int, norm: float) -> float:
        return (norm * h) ** (order + 1) / math.factorial(order + 1)

    order = taylor_order(h)
    assert remainder(order, 1.5) < 1e-14
    assert order == 2 or remainder(order - 1, 1.5) >= 1e-14
    wider = taylor_order(h, norm=4.0, tolerance=1e-6)
    assert remainder(wider, 4.0) < 1e-6
    assert wider == 2 or remainder(wider - 1, 4.0) >= 1e-6
    with pytest.raises(ModelError, match="too long for the flow"):
        taylor_order(1e3)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(
    ("delay", "start", "length"), [(0.0, 0.2, 0.7), (0.3, 0.0, 0.3), (0.3, 0.3, 0.7), (2.4, 0.4, 0.6)]
)
def test_a_late_drive_is_that_of_then(axis: int, delay: float, start: float, length: float) -> None:
    """Of this interval where it is of this one, else of one before, newest first."""
    u = RANDOM.standard_normal((2, 3))
    past = RANDOM.standard_normal((MAX_DELAY + 1, 2, 8))
    out = np.full(3, 9.0)
    late_polynomial(u, past, axis, delay, start, length, out)
    for at in (0.1, 0.5, 0.9):
        then = start + length * at - delay
        back = math.ceil(-then) if then < 0.0 else 0
        row = u[axis] if back == 0 else past[back - 1, axis, :3]
        assert Polynomial(out)(at) == pytest.approx(float(Polynomial(row)(then + back)), rel=1e-9, abs=1e-9)


def test_of_drives_older_than_what_is_kept_the_oldest_counts() -> None:
    u, past, out = RANDOM.standard_normal((2, 1)), RANDOM.standard_normal((MAX_DELAY + 1, 2, 8)), np.zeros(1)
    late_polynomial(u, past, 0, 27.5, 0.5, 0.5, out)
    assert out[0] == past[MAX_DELAY, 0, 0]


def test_delays_are_counted_in_intervals_within_what_is_kept() -> None:
    for late, expected in ((0.6, 1.2), (0.1, 0.2), (-0.3, 0.0), (100.0, MAX_DELAY - 1.0), (math.nan, MAX_DELAY - 1.0)):
        assert late_by(late, 0.5) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("columns", [5, 9, 12, 14])
def test_forces_push_the_velocities_of_two_axes_in_all_columns(columns: int) -> None:
    """out ← out + weight (∂f/∂s out + ∂f/∂c), the first column by the forces themselves."""
    first, weight = 2, 0.3
    push = Push(4, 17)
    for part in (push.force, push.by_states, push.by_constants):
        part[:] = RANDOM.standard_normal(part.shape)
    push.by_constants[:, :first] = 0.0  # what is sensed forces nothing
    out = RANDOM.standard_normal((4, columns))
    expected = out.copy()
    expected[[1, 3], 1:] += weight * (push.by_states @ out)[:, 1:]
    expected[[1, 3], 5:] += weight * push.by_constants[:, first : first + columns - 5]
    expected[[1, 3], 0] += weight * push.force
    push_two(first, weight, out, push)
    np.testing.assert_allclose(out, expected, rtol=1e-12)


def test_forces_push_the_velocity_of_one_axis_in_all_columns() -> None:
    first, weight, columns = 1, 0.3, 7
    push = Push(2, 9)
    for part in (push.force, push.by_states, push.by_constants):
        part[:] = RANDOM.standard_normal(part.shape)
    out = RANDOM.standard_normal((2, columns))
    expected = out.copy()
    expected[1, 1:] += weight * (push.by_states[0] @ out)[1:]
    expected[1, 3:] += weight * push.by_constants[0, first : first + columns - 3]
    expected[1, 0] += weight * push.force[0]
    push_one(first, weight, out, push)
    np.testing.assert_allclose(out, expected, rtol=1e-12)


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("effect", ["cubic_stiffness", "nonlinear_damping"])
def test_a_kick_is_the_force_amid_it_and_its_columns_are_differences(axes: int, effect: str) -> None:
    """v + w f(x, v + ½ w f(x, v)): −k3 x³ as it is, −d3 x² v from the middle; the columns by differences."""
    made = one_axis(**{effect: {}}) if axes == 1 else two_axes(**{effect: {}})
    settings, states, weight = made.arrays.settings[0], 2 * axes, 0.4
    constants = len(made.x) - states
    columns = 1 + states + int(settings["flow_constants"])
    sizes = np.array([0.3, 0.5])[:axes]
    s = np.array([0.8, -0.4, 0.5, 0.7])[:states]
    c = np.zeros(constants)
    c[-axes:] = sizes

    def after(s: Array, c: Array) -> Array:
        x, v, size = s[::2], s[1::2], c[-axes:]

        def force(v: Array) -> Array:
            return -size * x**3 if effect == "cubic_stiffness" else -size * x**2 * v

        found = s.copy()
        found[1::2] += weight * force(v + 0.5 * weight * force(v))
        return found

    for count in (1, columns):
        out = np.zeros((states, count))
        out[:, 0] = s
        if count > 1:
            out[:, 1 : 1 + states] = np.eye(states)
        kick(settings, c, weight, out, Push(states, constants))
        np.testing.assert_allclose(out[:, 0], after(s, c), rtol=1e-13)
    for j in range(columns - 1):
        ahead, behind = s.copy(), s.copy()
        more, less = c.copy(), c.copy()
        if j < states:
            ahead[j], behind[j] = s[j] + 1e-6, s[j] - 1e-6
        else:
            index = int(settings["sense_constants"]) + j - states
            more[index], less[index] = c[index] + 1e-6, c[index] - 1e-6
        np.testing.assert_allclose(out[:, 1 + j], (after(ahead, more) - after(behind, less)) / 2e-6, atol=1e-8)


@pytest.mark.parametrize("h", [0.05, 0.31, 0.44, -0.31])
def test_over_each_drift_goes_the_exponential_of_the_matrix_and_what_a_drive_adds(h: float) -> None:
    """So it does to Gauss's points within it."""
    c, found = np.zeros(9), np.full((LENGTHS, OF_A_LENGTH), 9.0)
    c[2:9] = 0.15, 1.1, 0.9, 0.07, 0.2, 0.3, 0.1
    drift_matrices(c, np.array([0.7, -0.4]), h, 40, found)
    both = np.zeros((5, 5))
    both[:4, :4], both[:4, 4] = free_motion(*c[2:9]), (0.0, 0.7, 0.0, -0.4)  # Van Loan
    points = 0.5 + 0.5 * np.polynomial.legendre.leggauss(3)[0]
    for length, one in zip(drift_lengths(), found, strict=False):
        for at, share, rounding in zip((0, 20, 40, 60), (1.0, *points), (1e-14, 1e-11, 1e-11, 1e-11), strict=True):
            expected = expm(both * length * share * h)[:4]
            np.testing.assert_allclose(one[at : at + 20].reshape(5, 4).T, expected, atol=rounding)


@pytest.mark.parametrize("columns", [12, 14, 16])
def test_a_drift_takes_all_columns_along(columns: int) -> None:
    drifts, out = RANDOM.standard_normal((LENGTHS, OF_A_LENGTH)), RANDOM.standard_normal((4, columns))
    expected = drifts[2, :16].reshape(4, 4).T @ out
    drift(2, drifts, out)
    np.testing.assert_allclose(out, expected, rtol=1e-12, atol=1e-14)


def test_forces_push_the_velocities_of_what_entries_of_the_field_do() -> None:
    by_states, entries, weight = RANDOM.standard_normal((2, 4)), RANDOM.standard_normal((4, 8)), 0.3
    expected = entries.copy()
    expected[[1, 3]] += weight * by_states @ entries
    push_entries(weight, by_states, entries)
    np.testing.assert_allclose(entries, expected, rtol=1e-12)


def test_slopes_at_both_ends_are_those_of_the_equation() -> None:
    made = two_axes()
    c, u = made.x[4:].copy(), DRIVE[:, :2].copy()
    c[2:9] = 0.15, 1.1, 0.9, 0.07, 0.2, 0.3, 0.1
    begin, end = np.array([0.8, -0.4, 0.5, 0.7]), np.array([0.1, 0.6, -0.3, 0.2])
    slopes = find_slopes(made.arrays.settings[0], c, u, begin, end)
    for found, state, drive in zip(slopes, (begin, end), (u[:, 0], u.sum(axis=1)), strict=True):
        expected = free_motion(*c[2:9]) @ state + np.array([0.0, drive[0], 0.0, drive[1]])
        np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_an_interval_is_cut_where_friction_turns_over(flip: float) -> None:
    """Where each velocity is −3, 0 and 3 times the speed of its turn; of a motion in closed form."""
    made = two_axes(dry_friction={"v0": 1.0})
    settings = made.arrays.settings[0]
    rest = 0.01
    settings["signal_parameters"][: int(settings["signal_count"]), 0] = rest
    c = np.zeros(len(made.x) - 4)
    c[3], c[4] = 1.0, 1.0
    h = 0.3
    work = FlowWork(4, len(c), 1)
    start = flip * np.array([np.cos(0.1), np.sin(0.1), 0.5 * np.cos(0.17), 0.5 * np.sin(0.17)])
    work.out[:, 0] = start
    cuts = turnovers(settings, Interval(0.0, h, np.zeros((2, 1))), c, work)
    expected = sorted(
        (since - math.asin(level * rest / size)) / h
        for since, size in ((0.1, 1.0), (0.17, 0.5))
        for level in (-3.0, 0.0, 3.0)
    )
    assert cuts.count == 6
    np.testing.assert_allclose(cuts.at[:6], expected, atol=1e-4)
    np.testing.assert_array_equal(work.out[:, 0], start)
    # Nothing turns over in a time in which the velocities keep their sign and are fast.
    work.out[:, 0] = expm(free_motion(0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)) @ start
    assert turnovers(settings, Interval(0.0, h, np.zeros((2, 1))), c, work).count == 0


@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_a_mass_catches_what_follows_it_with_play_on_both_sides_of_its_turn(flip: float) -> None:
    """Along x = t − t², which turns at ½: from 0.05 short of the half-width, and twice that on the way back."""
    width, way, cuts = 0.1, (0.0, flip, 0.0, -flip), Cuts()
    insert_sorted(cuts, 0.01)
    catches(flip * 0.05, width, way, 0.5, cuts)
    np.testing.assert_allclose(cuts.at[: cuts.count], [0.01, 0.5 - math.sqrt(0.2), 0.5 + math.sqrt(0.2)], atol=1e-9)
    # What is caught already is not caught again, and a way shorter than what is left catches nothing.
    catches(flip * width, width, way, 1.0, none := Cuts())
    catches(0.0, 0.3, way, 0.5, none)
    assert none.count == 0


def test_what_follows_with_play_begins_as_if_it_had_come_from_nothing() -> None:
    made = two_axes()
    settings, columns = made.arrays.settings[0], 20
    settings["slip_count"], settings["sense_constants"] = 4, 2
    stop, slip = Source.STOP.value, Source.SLIP.value
    settings["slips"][:4] = [(1, 0, 9, stop), (0, 1, 10, stop), (2, 0, 9, slip), (3, 0, 11, stop)]  # signals, then axes
    c = np.zeros(15)
    c[9:12] = 0.5, 0.6, 0.0
    for x, y, own_x, own_y in ((0.3, -0.9, True, False), (0.7, 0.2, False, True), (-0.7, 0.9, False, False)):
        push = Push(4, 15)
        push.slips[:] = 9.0
        s = np.array([x, 3.0, y, 4.0])
        begin_ways(settings, c, s, columns, push)
        expected = np.zeros((4, columns))
        for row, (at, width, own, constant) in enumerate(((x, 0.5, own_x, 9), (y, 0.6, own_y, 10))):
            expected[row, 0] = np.clip(at, -width, width)
            if own:
                expected[row, 1 + 2 * row] = 1.0
            else:
                expected[row, 1 + 4 + constant - 2] = np.sign(at)
        np.testing.assert_array_equal(push.slips[:4, :columns], expected)
        begin_ways(settings, c, s, 1, push)
        np.testing.assert_array_equal(push.slips[:4, 0], expected[:, 0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_slip_goes_with_the_motion_and_its_columns_are_differences(sign: float) -> None:
    """One way, and there and back: beside `slid`, which is tested by itself, along the ways of a parabola."""
    made = two_axes()
    settings, h, reach, columns = made.arrays.settings[0], 0.4, 0.6, 14
    settings["slip_count"], settings["sense_constants"] = 2, 2
    settings["slips"][:2] = [(0, 1, 9, Source.SLIP.value), (1, 0, 10, Source.SLIP.value)]
    c = np.zeros(12)
    c[9], c[10] = reach, -1.0
    before, out = RANDOM.standard_normal((4, columns)), RANDOM.standard_normal((4, columns))
    before[2:, 0], out[2:, 0] = (0.1 * sign, 0.5 * sign), (0.35 * sign, 0.9 * sign)
    push = Push(4, 12)
    slips = push.slips
    slips[:, :columns] = RANDOM.standard_normal((len(slips), columns))
    slips[0, 0] = 0.2 * sign
    known = slips[0].copy()
    slide(settings, c, h, before, out, push)
    assert not slips[1].any()  # without a reach there is none

    def ended(j: int, step: float) -> float:
        own = step if j == 1 + 4 + 9 - 2 else 0.0
        way = 0.25 * sign + step * (out[2, j] - before[2, j])
        return sign * slid(sign * (known[0] + step * known[j]), sign * way, reach + own)[0]

    assert slips[0, 0] == pytest.approx(ended(1, 0.0), rel=1e-13)
    for j in range(1, columns):
        assert slips[0, j] == pytest.approx((ended(j, 1e-6) - ended(j, -1e-6)) / 2e-6, abs=1e-8), j
    # It turns after 0.5/(0.5 + 0.3) of the interval, having gone half that time at 0.5.
    out[2:, 0] = 0.05 * sign, -0.3 * sign
    turn = 0.5 / 0.8
    forth = 0.5 * 0.5 * turn * h
    back = 0.05 - (0.1 + forth)
    slips[0] = known
    slide(settings, c, h, before, out, push)
    top, by_z, by_way, by_reach = slid(0.2, forth, reach)
    bottom, by_z_back, by_way_back, by_reach_back = slid(-top, -back, reach)
    assert slips[0, 0] == pytest.approx(-sign * bottom, rel=1e-12)
    for j in range(1, columns):
        moved = out[2, j] - before[2, j]
        own = float(j == 1 + 4 + 9 - 2)
        at_turn = by_z * known[j] + by_way * turn * moved + sign * by_reach * own
        ended_at = by_z_back * at_turn + by_way_back * (1.0 - turn) * moved - sign * by_reach_back * own
        assert slips[0, j] == pytest.approx(ended_at, abs=1e-12), j
    assert by_reach != 0.0


def test_a_force_of_a_slip_moves_with_it() -> None:
    made = two_axes()
    settings, weight, columns = made.arrays.settings[0], 0.3, 6
    settings["slip_count"] = 2
    settings["slips"][:2] = [(5, 1, 9, 0), (2, 0, 9, 0)]
    push = Push(4, 9)
    push.by_states[:] = RANDOM.standard_normal((2, 4))
    push.signals[MAX_SIGNALS + 5], push.signals[MAX_SIGNALS + 2] = 0.7, -0.4
    push.slips[:] = RANDOM.standard_normal(push.slips.shape)
    for moves in (False, True):
        out = RANDOM.standard_normal((4, columns))
        expected = out.copy()
        for row, slip, by_slip in ((3, 0, 0.7), (1, 1, -0.4)):
            amid = 1.0 + 0.5 * weight * push.by_states[row // 2, row] if moves else 1.0
            expected[row, 1:] += weight * by_slip * amid * push.slips[slip, 1:columns]
        push_slips(settings, weight, moves, out, push)
        np.testing.assert_allclose(out, expected, rtol=1e-12)
