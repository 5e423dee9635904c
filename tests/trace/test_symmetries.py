"""Look-alikes by symmetry: the equations with the other cause, solved by SciPy, give the same voltages."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from estimator.diagnosis import Interval
from estimator.effects.catalogue import EFFECTS, effect_for
from estimator.model import gyro
from estimator.trace.symmetries import Constants, equivalents
from tests.trace.equations import CORIOLIS, System, retimed, reversed_in_time, system_of, system_with

CONSTANTS = Constants((1.02, 0.98, 0.03), (4e-3, 5e-3, 5e-4), (1.0, 1.0, 0.0), 0.05)
T = np.linspace(0.0, 60.0, 241)


def push(t):
    """A drive about the resonance, nothing before 0."""
    rise = -math.expm1(-t) if t > 0.0 else 0.0
    return rise * np.array([math.sin(0.97 * t) + 0.3 * math.sin(1.7 * t), math.cos(1.03 * t) + 0.2 * math.sin(0.6 * t)])


def rate(t):
    return 0.02 + 0.01 * math.sin(0.2 * t)


def rate_change(t):
    return 0.002 * math.cos(0.2 * t)


def voltages(system: System, at, start=((0.0, 0.0), (0.0, 0.0)), unit=1.0, turning=1.0):
    """V at the instants `at` of the record, of a system whose second has `unit` seconds of the record's; start: V and
    its slope at the first; turning: times the rate.
    """
    sense, drive, late = (each * unit for each in system.late)

    def flow(own, state):
        x, v = state[:2], state[2:]
        t = own * unit
        w, change = turning * rate(t - late), turning * rate_change(t - late) * unit
        force = system.drive @ push(t - drive)
        c = system.coriolis
        a = force - system.damping @ v - system.stiffness @ x + 2 * w * c @ v + change * c @ x - w**2 * c @ c @ x
        return np.concatenate([v, a])

    back = np.linalg.inv(system.sense)
    begin = np.concatenate([back @ start[0], unit * back @ start[1]])
    own = (at - sense) / unit
    found = solve_ivp(flow, (min(own[0], at[0] / unit), own[-1]), begin, "DOP853", own, rtol=1e-10, atol=1e-12)
    return (system.sense @ found.y[:2]).T, (system.sense @ found.y[2:]).T / unit


def is_(value: float, half: float = 1e-5) -> Interval:
    return Interval(value, value - half, value + half, "1")


DRIVE_GAIN = {"drive_gain": {"hx": is_(0.03), "hy": is_(0.03)}}
FLIPPED = {"drive_gain": {"hx": is_(-2.02), "hy": is_(0.0)}}
SENSE_FLIPPED = {"sense_gain": {"gy": is_(-1.97)}}
DRIVE_TURNED = {"drive_misalignment": {"mx": is_(0.05), "my": is_(-0.05)}}
SENSE_TURNED = {"sense_cross_coupling": {"ex": is_(-0.05), "ey": is_(0.05)}}
SHARE = 1.03**-0.5 - 1.0
HEAVIER = {"sense_gain": {"gy": is_(SHARE)}, "drive_gain": {"hx": is_(0.0), "hy": is_(SHARE)}}
SENSE_LATE = {"sense_delay": {"tsx": is_(0.04), "tsy": is_(0.04)}}
DRIVE_LATE = {"drive_delay": {"tux": is_(0.04), "tuy": is_(0.04)}}

ALL = [
    (DRIVE_GAIN, {"clock_rate", "mass_scale", "sense_scale"}),
    (FLIPPED, {"drive_polarity", "sense_polarity"}),
    (SENSE_FLIPPED, {"drive_polarity", "sense_polarity"}),
    (DRIVE_TURNED, {"sense_cross_coupling"}),
    (SENSE_TURNED, {"drive_misalignment"}),
    (HEAVIER, {"unequal_masses"}),
    (SENSE_LATE, {"drive_delay"}),
    (DRIVE_LATE, {"sense_delay"}),
]


def of(named, constants=CONSTANTS, nonreciprocal=None):
    """By the other cause, each with the equations that it then has."""
    return {
        one.other: SimpleNamespace(**vars(one), told_by=one.told_by, system=system_of(one, named, constants))
        for one in equivalents(named, constants, nonreciprocal)
    }


@pytest.mark.moderate
@pytest.mark.parametrize(("named", "others"), ALL, ids=lambda given: "+".join(sorted(given)))
def test_the_other_cause_gives_the_same_voltages(named, others) -> None:
    found = of(named)
    assert set(found) == others
    seen, _ = voltages(system_with(named, CONSTANTS), T)
    base, _ = voltages(system_with({}, CONSTANTS), T)
    assert np.max(np.abs(seen - base)) > 1e-2 * np.max(np.abs(base))  # or anything would do
    for other, one in found.items():
        unit = 1.0 / (1.0 + one.size) if other == "clock_rate" else 1.0
        again, _ = voltages(one.system, T, unit=unit)
        assert np.max(np.abs(again - seen)) < 1e-7 * np.max(np.abs(seen)), other


@pytest.mark.moderate
def test_by_another_clock_every_path_is_as_late_as_it_was() -> None:
    late = replace(system_with(DRIVE_GAIN, CONSTANTS), late=(0.4, 1.3, 2.2))
    instants = T[:61]
    seen, _ = voltages(late, instants)
    again, _ = voltages(retimed(late, 1.25), instants, unit=1.25)
    assert np.max(np.abs(again - seen)) < 1e-7 * np.max(np.abs(seen))
    for path in range(3):
        other = replace(late, late=tuple(0.0 if path == one else seconds for one, seconds in enumerate(late.late)))
        assert np.max(np.abs(voltages(other, instants)[0] - seen)) > 1e-4 * np.max(np.abs(seen))  # each is seen


@pytest.mark.parametrize(("high", "listed"), [(-1.0, False), (-1.001, True)])
def test_a_drive_that_may_as_well_do_nothing_has_no_polarity(high: float, *, listed: bool) -> None:
    found = of({"drive_gain": {"hx": Interval(-1.5, -2.0, high, "1"), "hy": is_(0.0)}})
    assert ("drive_polarity" in found) is listed


@pytest.mark.parametrize(("named", "others"), ALL, ids=lambda given: "+".join(sorted(given)))
@pytest.mark.parametrize(
    "beside",
    [
        {"cubic_stiffness": {"k3x": is_(0.01), "k3y": is_(0.02)}},
        {"dry_friction": {"fx": is_(1e-3), "fy": is_(2e-3)}},
        {"sense_quadratic": {"a2x": is_(0.01), "a2y": is_(-0.01)}},
        {"interference:1": {"lsx": is_(0.1), "lcx": is_(0.1), "lsy": is_(0.1), "lcy": is_(0.1)}},
    ],
    ids=lambda given: next(iter(given)),
)
def test_each_symmetry_is_listed_beside_an_effect_as_without_one(named, others, beside) -> None:
    found = of(beside | named)
    assert set(found) == others
    for other, one in found.items():
        assert one.effect in named
        assert one.size == pytest.approx(of(named)[other].size)
        assert one.separate_by == of(named)[other].separate_by


def test_a_drive_reversed_on_both_axes_leaves_the_rate() -> None:
    found = of({"drive_gain": {"hx": is_(-2.0), "hy": is_(-2.0)}})
    assert set(found) == {"drive_polarity", "sense_polarity"}
    for one in found.values():
        assert one.separate_by == "tilt that axis: gravity tells the sign of its sense"
        assert one.system.coriolis == pytest.approx(CORIOLIS)
        assert one.angle == 0.0


def test_the_other_cause_is_what_its_name_says() -> None:
    one, flip = np.eye(2), np.diag([-1.0, 1.0])
    clock = of(DRIVE_GAIN)["clock_rate"]
    assert clock.size == pytest.approx(math.sqrt(1.03) - 1.0)
    assert clock.system.drive == pytest.approx(one)
    assert clock.system.sense == pytest.approx(one)
    assert clock.system.stiffness[0, 0] == pytest.approx(1.02 / 1.03)
    scale = of(DRIVE_GAIN)["sense_scale"]
    assert scale.system.sense == pytest.approx(1.03 * one)
    assert scale.system.drive == pytest.approx(one)
    assert scale.system.stiffness == pytest.approx(system_with({}, CONSTANTS).stiffness)
    sense = of(FLIPPED)["sense_polarity"]
    assert sense.system.sense == pytest.approx(flip)
    assert sense.system.drive == pytest.approx(np.diag([1.02, 1.0]))
    assert sense.system.coriolis == pytest.approx(-CORIOLIS)
    drive = of(SENSE_FLIPPED)["drive_polarity"]
    assert drive.system.drive == pytest.approx(np.diag([1.0, -1.0]))
    assert drive.system.sense == pytest.approx(np.diag([1.0, 0.97]))
    turned = of(DRIVE_TURNED)["sense_cross_coupling"]
    assert turned.system.sense @ turned.system.sense.T == pytest.approx(one)
    assert turned.system.sense[0, 1] == pytest.approx(math.sin(math.atan(0.05)))
    assert turned.system.drive == pytest.approx(math.hypot(1.0, 0.05) * one)
    assert turned.angle == pytest.approx(math.atan(0.05))
    assert turned.system.stiffness == pytest.approx(turned.system.stiffness.T)
    turned = of(SENSE_TURNED)["drive_misalignment"]
    assert turned.system.sense == pytest.approx(math.hypot(1.0, 0.05) * one)
    assert turned.system.drive[0, 1] == pytest.approx(math.sin(math.atan(-0.05)))
    assert of(SENSE_LATE)["drive_delay"].system.late == pytest.approx((0.0, 0.04, 0.04))
    assert of(DRIVE_LATE)["sense_delay"].system.late == pytest.approx((0.04, 0.0, -0.04))


def heavier(mass: float, stiffness: float) -> System:
    """M ẍ + D ẋ + K x = u + 2 Ω C ẋ with `mass` on y, by its own inverse; stiffness: kxy, so that K is symmetric."""
    inverse = np.diag([1.0, 1.0 / mass])
    k = np.array([[1.02, stiffness], [stiffness, 0.98 * mass]])
    d = np.array([[4e-3, 5e-4], [5e-4, 5e-3 * mass]])
    return System(inverse @ k, inverse @ d, inverse, np.eye(2), inverse @ CORIOLIS)


def test_unequal_masses_are_two_gains_of_one_axis() -> None:
    one = of(HEAVIER)["unequal_masses"]
    assert one.size == pytest.approx(0.03)
    made = heavier(1.03, 0.03 / (1.0 + SHARE))
    assert one.system.drive == pytest.approx(made.drive)
    assert one.system.sense == pytest.approx(np.eye(2))
    assert one.system.stiffness == pytest.approx(made.stiffness)
    assert one.system.coriolis == pytest.approx(math.sqrt(1.03) * made.coriolis)  # of a rate √m times as large


def seen_of_mass(axis, mass, kxy):
    """What a trace names, its constants and kn, where an axis has so many times the mass of the other."""
    kn = 0.5 * kxy * (1.0 - 1.0 / mass) * (1.0 if axis == 1 else -1.0)
    gains = [is_(0.0), is_(0.0)]
    gains[axis] = is_(1.0 / mass - 1.0)
    named = {"drive_gain": {"hx": gains[0], "hy": gains[1]}, "nonreciprocal_stiffness": {"kn": is_(kn)}}
    return named, replace(CONSTANTS, stiffness=(1.02, 0.98, 0.5 * kxy * (1.0 + 1.0 / mass))), kn


@pytest.mark.moderate
@pytest.mark.parametrize("axis", [0, 1])
def test_unequal_masses_are_a_drive_gain_and_an_asymmetric_stiffness(axis: int) -> None:
    mass, kxy = 1.03, 0.03
    named, symmetric, kn = seen_of_mass(axis, mass, kxy)
    found = of(named, symmetric, is_(kn))
    assert set(found) == {"unequal_masses"}
    assert found["unequal_masses"].size == pytest.approx(0.03)
    assert found["unequal_masses"].separate_by == "turn the gyro at a varying rate"
    inverse = np.eye(2)
    inverse[axis, axis] = 1.0 / mass
    true = system_with({}, CONSTANTS)
    force = np.array([[1.02, kxy], [kxy, 0.98]])
    force[axis, axis] *= mass
    made = System(inverse @ force, true.damping, inverse, np.eye(2), inverse @ CORIOLIS)
    seen, _ = voltages(system_with(named, symmetric), T, turning=0.0)
    again, _ = voltages(made, T, turning=0.0)
    assert np.max(np.abs(again - seen)) < 1e-7 * np.max(np.abs(seen))
    assert found["unequal_masses"].system.coriolis == pytest.approx(made.coriolis)
    # A record that says there is no such stiffness tells the two apart.
    assert of({"drive_gain": named["drive_gain"]}, symmetric, is_(0.0)) == {}
    assert of({"drive_gain": named["drive_gain"]}, symmetric, is_(-kn)) == {}


@pytest.mark.moderate
def test_a_record_that_runs_backwards_has_a_damping_that_drives() -> None:
    constants = replace(CONSTANTS, damping=(-4e-3, -5e-3, -5e-4))
    (found,) = of({"sense_cubic": {"a3x": is_(0.1)}}, constants).values()
    assert (found.effect, found.other) == ("sense_cubic", "time_reversal")
    system = system_with({}, constants)
    seen, slope = voltages(system, T, start=(np.array([1.0, 0.0]), np.array([0.0, 0.3])))
    back = reversed_in_time(system)
    end = T[-1]

    def flow(t, state):
        x, v = state[:2], state[2:]
        w, change, c = rate(end - t), -rate_change(end - t), back.coriolis
        force = back.drive @ push(end - t)
        a = force - back.damping @ v - back.stiffness @ x + 2 * w * c @ v + change * c @ x - w**2 * c @ c @ x
        return np.concatenate([v, a])

    begin = np.concatenate([seen[-1], -slope[-1]])
    again = solve_ivp(flow, (0.0, end), begin, "DOP853", T, rtol=1e-10, atol=1e-12).y[:2].T
    assert np.max(np.abs(again[::-1] - seen)) < 1e-7 * np.max(np.abs(seen))
    assert np.all(np.linalg.eigvalsh(found.system.damping) > 0.0)
    assert "time_reversal" not in of({"sense_cubic": {"a3x": is_(0.1)}})


@pytest.mark.parametrize("mutual", [-0.5, 0.5])
def test_a_damping_that_drives_in_one_direction_has_no_reversal(mutual: float) -> None:
    """Its eigenvalues are −0.9 and 0.1: neither this way nor the other is it a passive device."""
    constants = replace(CONSTANTS, damping=(-0.4, -0.4, mutual))
    assert "time_reversal" not in of({"sense_cubic": {"a3x": is_(0.1)}}, constants)


def test_what_is_on_no_symmetry_has_no_equivalent() -> None:
    assert of({}) == {}
    assert of({"cubic_stiffness": {"k3x": is_(1.0), "k3y": is_(1.0)}}) == {}
    assert of({"drive_gain": {"hx": is_(0.03), "hy": is_(0.02)}}, nonreciprocal=None) == {}
    assert of({"drive_misalignment": {"mx": is_(0.05), "my": is_(0.05)}}) == {}
    assert of({"sense_cross_coupling": {"ex": is_(0.05), "ey": is_(0.0)}}) == {}
    assert of({"sense_delay": {"tsx": is_(0.04), "tsy": is_(0.0)}}) == {}
    assert of({"drive_gain": {"hx": is_(-0.9, 0.05), "hy": is_(0.0)}}) == {}
    assert of({"drive_gain": {"hx": is_(-1.1, 0.2), "hy": is_(0.0)}}) == {}  # the sign is not sure
    assert of({"drive_gain": {"hx": is_(-0.99999, 2e-4), "hy": is_(-1.0, 2e-4)}}) == {}  # nor that either drives


def test_a_clock_that_declared_stiffness_excludes_is_not_listed() -> None:
    sure = replace(CONSTANTS, declared=(1.02, 0.98, 0.03), spread=0.003)
    assert set(of(DRIVE_GAIN, sure)) == {"mass_scale", "sense_scale"}
    slower = replace(sure, declared=(1.02 / 1.03, 0.98 / 1.03, 0.03))
    assert "clock_rate" in of(DRIVE_GAIN, slower)


def declared(one) -> dict[str, dict[str, float]]:
    """What its words would put into the bench file."""
    found = re.findall(r"\[effects\.(\w+)\] ((?:\w+ = [-+.\de]+(?:, )?)+)", one.declare)
    return {name: {k: float(v) for k, v in re.findall(r"(\w+) = ([-+.\de]+)", given)} for name, given in found}


def acceleration(effects: dict[str, dict[str, float]], k, d, turning: float, state, u) -> np.ndarray:
    """(ẍ, ÿ) of the base model with constants k, d (2, 2) and a rate of `turning` × 0.02, with the effects declared."""
    x, v = state[:2], state[2:]
    w = 0.02 * turning
    a = u - d @ v - k @ x + 2 * w * CORIOLIS @ v
    at = dict(zip((gyro.x, gyro.y, gyro.vx, gyro.vy), state, strict=True)) | {gyro.ux: u[0], gyro.uy: u[1]}
    at |= {gyro.rate: w, gyro.kxx: k[0, 0], gyro.kyy: k[1, 1], gyro.kxy: k[0, 1]}
    at |= {gyro.dxx: d[0, 0], gyro.dyy: d[1, 1], gyro.dxy: d[0, 1]}
    for name, given in effects.items():
        _, effect = effect_for(name, 2)
        own = {p.symbol: given.get(p.name, p.default) for p in effect.parameters}
        own |= {c.symbol: given[c.name] for c in effect.coefficients}
        a = a + np.array([float(sp.sympify(part).subs(at | own)) for part in effect.force])
    return a


def of_system(system: System, state, u) -> np.ndarray:
    x, v = state[:2], state[2:]
    return system.drive @ u - system.damping @ v - system.stiffness @ x + 2 * 0.02 * system.coriolis @ v


STATE, PUSH = np.array([0.7, -0.4, 0.3, 0.9]), np.array([0.05, -0.08])


@pytest.mark.moderate
def test_a_clock_declared_by_its_listed_words_is_the_named_drive_gain() -> None:
    clock = of(DRIVE_GAIN)["clock_rate"]
    words = declared(clock)
    assert words == {"clock_rate": {"delta": pytest.approx(math.sqrt(1.03) - 1.0, rel=1e-5)}}
    true = clock.system
    made = acceleration(words, true.stiffness, true.damping, 1.0, STATE, PUSH)
    assert made == pytest.approx(of_system(system_with(DRIVE_GAIN, CONSTANTS), STATE, PUSH), abs=1e-6)
    other = {"clock_rate": {"delta": -words["clock_rate"]["delta"]}}
    wrong = acceleration(other, true.stiffness, true.damping, 1.0, STATE, PUSH)
    assert np.max(np.abs(wrong - made)) > 1e-2


def test_masses_declared_by_their_listed_words_are_the_two_named_gains() -> None:
    masses = of(HEAVIER)["unequal_masses"]
    words = declared(masses)
    assert words == {"unequal_masses": {"m": pytest.approx(0.03, rel=1e-5)}}
    weight, true = np.diag([1.0, 1.03]), masses.system
    made = acceleration(words, weight @ true.stiffness, weight @ true.damping, true.coriolis[0, 1], STATE, PUSH)
    assert made == pytest.approx(of_system(true, STATE, PUSH), abs=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
def test_masses_declared_for_a_drive_gain_are_the_same_system(axis: int) -> None:
    mass, kxy = 1.03, 0.03
    named, symmetric, kn = seen_of_mass(axis, mass, kxy)
    one = of(named, symmetric, is_(kn))["unequal_masses"]
    weight = np.eye(2)
    weight[axis, axis] = mass
    # Forces are over the mass of x.
    by = weight[0, 0]
    force = [weight @ matrix / by for matrix in (one.system.stiffness, one.system.damping)]
    force[1][0, 1] = force[1][1, 0] = 0.0  # the damping found is symmetric, over the masses
    plain = replace(one.system, damping=np.diag(np.diag(one.system.damping)))
    made = acceleration(declared(one), force[0], force[1], plain.coriolis[0, 1], STATE, PUSH)
    assert made == pytest.approx(of_system(plain, STATE, PUSH), abs=1e-6)


@pytest.mark.parametrize(
    ("named", "other", "effects"),
    [
        (FLIPPED, "drive_polarity", {"drive_polarity": {"px": 1.0}}),
        (FLIPPED, "sense_polarity", {"sense_polarity": {"px": 1.0}}),
        (SENSE_FLIPPED, "sense_polarity", {"sense_polarity": {"py": 1.0}}),
        (SENSE_FLIPPED, "drive_polarity", {"drive_polarity": {"py": 1.0}}),
        (DRIVE_TURNED, "sense_cross_coupling", {"sense_cross_coupling": {"ex": 0.05, "ey": -0.05}}),
        (SENSE_TURNED, "drive_misalignment", {"drive_misalignment": {"mx": -0.05, "my": 0.05}}),
        (SENSE_LATE, "drive_delay", {"drive_delay": {"tux": 0.04, "tuy": 0.04}}),
        (DRIVE_LATE, "sense_delay", {"sense_delay": {"tsx": 0.04, "tsy": 0.04}}),
    ],
)
def test_the_words_declare_the_other_cause(named, other, effects) -> None:
    one = of(named)[other]
    assert declared(one) == effects
    assert one.told_by == f"{one.separate_by}; if so, declare {one.declare}"


def test_a_scale_is_declared_where_the_bench_file_has_it() -> None:
    found = of(DRIVE_GAIN)
    assert {one.angle for one in found.values()} == {0.0}  # a common scale turns nothing
    assert (found["sense_scale"].size, found["mass_scale"].size) == (pytest.approx(0.03), pytest.approx(1 / 1.03 - 1.0))
    assert found["sense_scale"].declare == "[device.sense] gain_V_per_m times 1.03"
    assert found["mass_scale"].declare.startswith("[device] mass_kg times 0.970874 ")


def test_all_that_only_a_declaration_can_tell_is_listed_beside_something() -> None:
    """One place says what is no candidate; each of these is what a named effect may be as well."""
    listed = {other for named, _ in ALL for other in of(named)}
    hidden = {effect.name for effect in EFFECTS if effect.declared_only}
    assert hidden <= listed


@pytest.mark.parametrize(("axis", "symbols"), [(0, ("hx", "hy")), (1, ("hy", "hx"))])
def test_a_sense_gain_of_one_axis_is_a_drive_gain_of_that_axis(axis: int, symbols: tuple[str, str]) -> None:
    """V = S (1 + g) x of one axis, in units of V: the drive pushes by 1 + g, kxy and kyx are 1 + g and 1/(1 + g) ×."""
    g, kxy = 0.0333, 0.03
    scaled = np.diag([1.0 + g, 1.0] if axis == 0 else [1.0, 1.0 + g])
    seen = scaled @ np.array([[1.02, kxy], [kxy, 0.98]]) @ np.linalg.inv(scaled)
    kn = 0.5 * (seen[0, 1] - seen[1, 0])
    stiffness = seen[0, 0], seen[1, 1], 0.5 * (seen[0, 1] + seen[1, 0])
    constants = Constants(stiffness, (4e-3, 4e-3, 0.0), (1.0, 1.0), 0.05)
    named = {"drive_gain": {symbols[0]: is_(g, 1e-4), symbols[1]: is_(0.0, 1e-4)}}
    same = of(named, constants, is_(kn, 1e-6))["sense_gain"]
    assert same.size == pytest.approx(g)
    # A bench file has a sense gain of y beside that of x, none of x.
    assert declared(same) == ({"sense_gain": {"gy": pytest.approx(g)}} if axis == 1 else {})
    np.testing.assert_allclose(same.system.drive, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(same.system.sense, scaled)
    assert [one for one in equivalents(named, constants, is_(-kn, 1e-6)) if one.other == "sense_gain"] == []
    both = {"drive_gain": {"hx": is_(g, 1e-4), "hy": is_(g, 1e-4)}}
    assert [one for one in equivalents(both, constants, is_(kn, 1e-6)) if one.other == "sense_gain"] == []


def between(low: float, value: float, high: float) -> Interval:
    return Interval(value, low, high, "1")


@pytest.mark.parametrize(("gain", "others"), [(-0.2, 3), (0.25, 3), (-1.0, 0), (-1.5, 0)])
def test_a_common_drive_gain_is_a_scale_as_long_as_it_drives_the_same_way(gain: float, others: int) -> None:
    """With g = 1 + h: of time by √g, of the mass by 1/g, of what is sensed by g."""
    named = {"drive_gain": {axis: between(gain - 0.01, gain, gain + 0.01) for axis in ("hx", "hy")}}
    constants = Constants((1.0, 1.0, 0.0), (0.1, 0.1, 0.0), (1.0, 1.0, 0.0), 9.0)
    found = {one.other: one.size for one in equivalents(named, constants, None)}
    scales = {name: found[name] for name in ("clock_rate", "mass_scale", "sense_scale") if name in found}
    assert len(scales) == others
    if others:
        expected = {"clock_rate": math.sqrt(1.0 + gain), "mass_scale": 1.0 / (1.0 + gain), "sense_scale": 1.0 + gain}
        assert scales == {name: pytest.approx(one - 1.0) for name, one in expected.items()}


def test_a_polarity_changes_a_gain_by_twice_its_size() -> None:
    named = {"drive_gain": {"hx": between(-2.1, -2.0, -1.9), "hy": between(-0.1, 0.0, 0.1)}}
    constants = Constants((1.0, 1.0, 0.0), (0.1, 0.1, 0.0), (1.0, 1.0, 0.0), 9.0)
    found = {one.other: one.size for one in equivalents(named, constants, None)}
    assert (found["drive_polarity"], found["sense_polarity"]) == (-2.0, -2.0)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_large_drive_gain_equals_a_sense_gain_with_a_coupling(axis: int) -> None:
    """In coordinates scaled by g the couplings kxy + kn and kxy − kn are as one to g²."""
    gain, kxy = 1.5, 0.03
    kn = kxy * (gain**2 - 1.0) / (gain**2 + 1.0) * (1.0 if axis == 0 else -1.0)
    drive = [between(-1e-3, 0.0, 1e-3), between(-1e-3, 0.0, 1e-3)]
    drive[axis] = between(0.49, 0.5, 0.51)
    named = {"drive_gain": dict(zip(("hx", "hy"), drive, strict=True))}
    other = of(named, CONSTANTS, between(kn - 1e-6, kn, kn + 1e-6))["sense_gain"]
    assert other.size == pytest.approx(0.5)
    scale = np.ones(2)
    scale[axis] = gain
    np.testing.assert_allclose(other.system.sense, np.diag(scale))
    assert "sense_gain" not in {one.other for one in equivalents(named, CONSTANTS, between(-kn, -0.8 * kn, -0.7 * kn))}
