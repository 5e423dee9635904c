"""What a law of the library says in a bench file is what its effect does, and its vectors turn with the plane."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp

from estimator.effects.declaration import Effect, Source, name_of
from estimator.missing_force.library import Term, library
from estimator.scaling import Scaling
from estimator.trace.problem import Problem
from tests.estimator.missing_force.simulated import simulated

SAMPLES = 2000
WORDS = {"sqrt": math.sqrt, "abs": abs, "cos": math.cos, "sin": math.sin, "exp": math.exp}


@cache
def problem(axes: int) -> Problem:
    return simulated(lambda q, v: 0.0 * q, axes=axes, samples=SAMPLES, noise=1e-3).problem


@cache
def terms(axes: int) -> tuple[Term, ...]:
    """With a line beside the resonance in the residual, so that a change of stiffness is looked for."""
    t = np.arange(SAMPLES) / 4000.0
    beside = 1e-3 * np.cos(2.0 * np.pi * 212.0 * t) + 1e-5 * np.random.default_rng(3).standard_normal(SAMPLES)
    return library(problem(axes), np.tile(beside[:, None], axes))


def along(
    effect: Effect, given: dict[str, float], scaling: Scaling, series: dict[str, np.ndarray], axes: int
) -> tuple[np.ndarray, np.ndarray]:
    """Force and sensed displacement (n, axes), scaled, of a law with its numbers `given` (SI) along series (n,)."""
    numbers = {name_of(one): given[one.name] / scaling.coefficient(one) for one in effect.coefficients}
    numbers |= {name_of(one): given[one.name] / scaling.coefficient(one) for one in effect.parameters}
    times = {name_of(signal): series["t"] for signal in effect.signals if signal.source is not Source.PARAMETER}
    values = {**series, **times, **numbers}
    out = np.zeros((2, len(series["t"]), axes))
    for place, laws in enumerate((effect.force, effect.sense)):
        for axis, law in enumerate(laws[:axes]):
            names = sorted(symbol.name for symbol in law.free_symbols)
            plain = law.subs({symbol: sp.Symbol(symbol.name) for symbol in law.free_symbols})
            out[place, :, axis] = sp.lambdify(sp.symbols(names), plain, "numpy")(*(values[name] for name in names))
    return out[0], out[1]


def moving(axes: int) -> tuple[dict[str, np.ndarray], Scaling]:
    random, scaling = np.random.default_rng(5), Scaling.of(problem(axes).device)
    series = {name: random.normal(size=6) for name in ("x", "y", "vx", "vy", "ux", "uy", "t")}
    return series | {"T": np.zeros(6)}, scaling


@pytest.mark.parametrize("axes", [1, 2])
def test_a_law_in_si_is_what_the_effect_does(axes: int) -> None:
    series, scaling = moving(axes)
    length, speed = scaling.length, scaling.length * scaling.omega0
    si = {"x": length, "y": length, "vx": speed, "vy": speed, "ux": scaling.force, "uy": scaling.force}
    for term in terms(axes):
        given = {c.name: 0.3 * (k + 1) * scaling.coefficient(c) for k, c in enumerate(term.effect.coefficients)}
        given |= {p.name: 0.4 * scaling.coefficient(p) for p in term.effect.parameters}
        force, sensed = along(term.effect, given, scaling, series, axes)
        for k in range(6):
            at = {name: values[k] * si.get(name, 1.0 / scaling.omega0) for name, values in series.items()}
            at |= {"r": math.hypot(at["x"], at["y"]), "v": math.hypot(at["vx"], at["vy"]), **given, **WORDS}
            for axis in range(axes):
                said = sum(
                    given[f"c_{label.replace(' ', '_')}"] * eval(laws[axis], {}, at)
                    for label, laws in term.laws.items() if laws[axis]
                )  # fmt: skip
                done = force[k, axis] * scaling.force + sensed[k, axis] * length
                assert done == pytest.approx(said, rel=1e-6), term.form


def test_vectors_of_the_plane_turn_with_it() -> None:
    """A law with one coefficient for both axes that is no gradient is the same in every direction."""
    series, scaling = moving(2)
    c, s = math.cos(0.6), math.sin(0.6)
    turned = dict(series)
    for x, y in (("x", "y"), ("vx", "vy")):
        turned[x], turned[y] = c * series[x] - s * series[y], s * series[x] + c * series[y]
    for term in terms(2):
        if list(term.laws) != ["both"] or term.form.startswith("∇"):
            continue
        given = {term.effect.coefficients[0].name: scaling.coefficient(term.effect.coefficients[0])}
        one, other = (along(term.effect, given, scaling, each, 2)[0] for each in (series, turned))
        assert other == pytest.approx(one @ np.array([[c, s], [-s, c]]), rel=1e-6, abs=1e-9), term.form


def test_a_stiffness_may_change_at_a_line_s_distance_from_resonance() -> None:
    (wave,) = (term for term in terms(2) if term.form.startswith("q cos"))
    assert wave.effect.parameters[0].tried[0] * Scaling.of(problem(2).device).omega0 == pytest.approx(
        2.0 * np.pi * 12.0, rel=0.01
    )


def test_without_a_drive_no_law_speaks_of_one() -> None:
    record = problem(2).record
    still = problem(2).on(replace(record, drive=0.0 * record.drive))
    assert not any("u" in term.form for term in library(still, record.sense))
