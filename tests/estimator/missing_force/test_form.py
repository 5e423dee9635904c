"""The form of a missing force beside the law that SciPy's integrator was given; constants are not known beforehand."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.missing_force.estimate import missing_force
from estimator.missing_force.library import Extent, library
from estimator.missing_force.result import MissingForce
from estimator.trace.problem import Problem
from tests.estimator.missing_force.simulated import GAIN, LENGTH, OMEGA, Floats, Force, simulated

pytestmark = pytest.mark.slow

NOISE, SAMPLES = 3e-4, 10_000


def asked(force: Force, axes: int) -> tuple[MissingForce, Problem]:
    record = simulated(force, axes=axes, samples=SAMPLES, noise=NOISE)
    return missing_force(record.problem, round(0.6 * SAMPLES)), record.problem


def named(found: MissingForce) -> list[str]:
    return [f"{'sensed ' if term.sense else ''}{term.form}" for term in found.form.terms]


@pytest.mark.long
def test_a_cubic_spring_on_each_axis_is_its_own_form() -> None:
    true = np.array([0.03, 0.015])
    found, _ = asked(lambda q, v: -true * q**3, 2)
    assert named(found) == ["q³"]
    assert found.form.left < 0.1
    for axis, size in zip("xy", true, strict=True):
        one = found.form.terms[0].coefficients[axis]
        assert one.unit == "1/(m²·s²)"
        assert one.value == pytest.approx(-size * OMEGA**2 / LENGTH**2, rel=0.02)
        assert one.low < one.value < one.high


@pytest.mark.long
def test_a_law_of_the_plane_has_one_coefficient() -> None:
    found, _ = asked(lambda q, v: -0.02 * (q @ q) * v, 2)
    assert named(found) == ["r² v"]
    (name, one), = found.form.terms[0].coefficients.items()  # fmt: skip
    assert name == "both"
    assert one.unit == "1/(m²·s)"
    assert one.value == pytest.approx(-0.02 * OMEGA / LENGTH**2, rel=0.03)


@pytest.mark.long
def test_a_law_that_crosses_the_axes_on_one_of_them() -> None:
    found, _ = asked(lambda q, v: np.array([-0.03 * q[1] ** 2 * v[0], 0.0]), 2)
    assert named(found) == ["p² v"]
    x, y = (found.form.terms[0].coefficients[axis] for axis in "xy")
    assert x.value == pytest.approx(-0.03 * OMEGA / LENGTH**2, rel=0.05)
    assert abs(y.value) < 0.05 * abs(x.value)


@pytest.mark.long
def test_friction_of_a_single_axis() -> None:
    found, _ = asked(lambda q, v: -0.002 * np.tanh(v / 0.03), 1)
    assert named(found) == ["tanh(v/v0)"]
    term = found.form.terms[0]
    assert term.coefficients["x"].unit == "m/s²"
    assert term.coefficients["x"].value == pytest.approx(-0.002 * LENGTH * OMEGA**2, rel=0.05)


@pytest.mark.long
def test_a_gap_is_found_between_those_that_are_tried() -> None:
    def gap(q: Floats, v: Floats) -> Floats:
        return -0.03 * (q - np.clip(q, -0.55, 0.55))

    found, _ = asked(gap, 1)
    assert named(found) == ["q beyond ±g"]
    assert found.form.terms[0].threshold["g"].value == pytest.approx(0.55 * LENGTH, rel=0.01)


def sensed(change: Callable[[Floats], Floats]) -> MissingForce:
    """A device with nothing amiss, whose readings (n, 2), V, are changed."""
    problem = simulated(lambda q, v: 0.0 * q, axes=2, samples=SAMPLES, noise=NOISE).problem
    record = problem.record
    return missing_force(problem.on(replace(record, sense=change(record.sense))), round(0.6 * SAMPLES))


@pytest.mark.long
def test_a_rail_that_the_readings_stop_at() -> None:
    """The noise comes behind it."""
    problem = simulated(lambda q, v: 0.0 * q, axes=2, samples=SAMPLES, noise=1e-9).problem.part(slice(0, 9000))
    plain = problem.record.sense
    rail = 0.8 * float(np.max(np.abs(plain)))
    noise = NOISE * GAIN * LENGTH * np.random.default_rng(8).standard_normal(plain.shape)
    device = replace(problem.device, noise=(NOISE * GAIN * LENGTH,) * 2)
    record = replace(problem.record, sense=np.clip(plain, -rail, rail) + noise)
    found = missing_force(replace(problem, device=device, record=record), 7000)
    assert named(found) == ["sensed reading beyond ±L"]
    assert found.form.terms[0].threshold["L"].value * GAIN == pytest.approx(rail, rel=1e-3)
    assert found.form.left < 0.1


@pytest.mark.long
def test_values_that_a_converter_loses() -> None:
    def shown(volts: Floats) -> Floats:
        codes = np.round(volts / 7.6e-6)
        beyond = codes % 4096
        return np.asarray(np.where(beyond < 150, codes - beyond, codes) * 7.6e-6)

    found = sensed(shown)
    assert named(found) == ["sensed reading less lost values"]
    assert found.form.terms[0].coefficients["x"].value == pytest.approx(1.0, abs=0.03)


@pytest.mark.long
def test_an_offset_that_switches_between_two_levels() -> None:
    rng = np.random.default_rng(4)
    level = np.cumprod(np.where(rng.random(SAMPLES) < 1.0 / 600.0, -1.0, 1.0))
    half = 1.5 * NOISE * GAIN * LENGTH
    found = sensed(lambda volts: volts + np.stack([half * level, 0.0 * level], axis=1))
    assert named(found) == ["sensed offset of two levels"]
    assert abs(found.form.terms[0].coefficients["x"].value) * GAIN == pytest.approx(half, rel=0.05)
    assert list(found.form.terms[0].coefficients) == ["x"]


@pytest.mark.long
def test_an_offset_that_wanders_has_no_two_levels() -> None:
    rng = np.random.default_rng(4)
    walk = np.cumsum(rng.standard_normal(SAMPLES)) * 0.1 * NOISE * GAIN * LENGTH
    assert "sensed offset of two levels" not in named(sensed(lambda volts: volts + walk[:, None]))


@pytest.mark.long
def test_an_offset_that_decays_has_its_rate() -> None:
    t = np.arange(SAMPLES) / 4000.0
    found = sensed(lambda volts: volts + 0.1 * GAIN * LENGTH * np.exp(-3.0 * t)[:, None] * np.array([1.0, 0.0]))
    assert named(found) == ["sensed exp(-k t)"]
    assert found.form.terms[0].threshold["k"].value == pytest.approx(3.0, rel=0.02)


@pytest.mark.long
def test_where_nothing_is_missing_no_form_is_proposed() -> None:
    found, _ = asked(lambda q, v: 0.0 * q, 2)
    assert named(found) == []
    assert found.form.left == 1.0


@pytest.mark.long
def test_what_is_left_is_less_than_the_force() -> None:
    found, _ = asked(lambda q, v: -np.array([0.03, 0.015]) * q**3, 2)
    later = slice(found.split, None)
    left, force = (float(np.sqrt(np.mean(series[later] ** 2))) for series in (found.left, found.force))
    assert left < 0.2 * force


@pytest.mark.long
def test_uneven_samples_are_refused_in_words() -> None:
    record = simulated(lambda q, v: 0.0 * q, axes=1, samples=2000, noise=NOISE).problem.record
    record.step[500:] *= 1.01
    problem = simulated(lambda q, v: 0.0 * q, axes=1, samples=2000, noise=NOISE).problem.on(record)
    with pytest.raises(ModelError, match="not evenly spaced"):
        missing_force(problem, 1200)


@pytest.mark.parametrize("axes", [1, 2])
def test_every_term_has_the_dimension_that_it_says(axes: int) -> None:
    """Twice the length scale, three times the time scale: the term grows by these powers."""
    import sympy as sp

    extent = Extent(1.0, 1.0, 1.0, lines=(0.3,), modulations=(0.2,), warm=True)
    rng = np.random.default_rng(1)
    at = dict(zip(("x", "y", "vx", "vy", "ux", "uy"), rng.uniform(-1.5, 1.5, 6), strict=True)) | {"t": 0.7}
    powers = {"x": (1, 0), "y": (1, 0), "vx": (1, -1), "vy": (1, -1), "ux": (1, -2), "uy": (1, -2), "t": (0, 1)}
    for term in library(axes, extent):
        if term.series is not None or term.form.startswith("T"):
            continue
        grown = term
        if term.threshold is not None:
            _, value, length, time = term.threshold
            grown = term.at(value * 2.0**length * 3.0**time) if term.general else None
        if grown is None:
            continue
        for before, after in zip(term.columns, grown.columns, strict=True):
            for one, two in zip(before, after, strict=True):

                def value_of(expression: sp.Expr, scaled: bool) -> float:
                    values = {
                        symbol: at[symbol.name] * (2.0 ** powers[symbol.name][0] * 3.0 ** powers[symbol.name][1]
                                                   if scaled else 1.0)
                        for symbol in expression.free_symbols
                    }  # fmt: skip
                    return float(sp.sympify(expression).subs(values))

                expected = value_of(one, False) * 2.0**term.length * 3.0**term.time
                assert value_of(two, True) == pytest.approx(expected, rel=1e-9, abs=1e-12), term.name


def test_vectors_of_the_plane_turn_with_it() -> None:
    """A law with one coefficient for both axes that is no gradient is the same in every direction."""
    import sympy as sp

    x, y, vx, vy = sp.symbols("x y vx vy", real=True)
    angle = 0.6
    c, s = np.cos(angle), np.sin(angle)
    at = {x: 0.4, y: -0.7, vx: 0.3, vy: 0.9}
    turned = {x: c * 0.4 + s * 0.7, y: s * 0.4 - c * 0.7, vx: c * 0.3 - s * 0.9, vy: s * 0.3 + c * 0.9}
    for term in library(2, Extent(1.0, 1.0, 1.0)):
        if term.axes != ("both",) or term.form.startswith("∇"):
            continue
        (one, two), = term.columns  # fmt: skip
        fx, fy = float(one.subs(at)), float(two.subs(at))
        gx, gy = float(one.subs(turned)), float(two.subs(turned))
        assert (gx, gy) == pytest.approx((c * fx - s * fy, s * fx + c * fy), rel=1e-9), term.form
