"""What a term says in SI, in the grammar of [effects.custom], is what it says in scaled units."""

import math
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp

from estimator.missing_force.estimate import in_si
from estimator.missing_force.library import Extent, Term, library
from hil.bench.own import OwnCoefficient, OwnEffect, OwnParameter

LENGTH, OMEGA = 3.0e-6, 2.0 * math.pi * 1700.0
EXTENT = Extent(1.1, 1.2, 0.02, lines=(0.7,), modulations=(0.013,), warm=True, steepest=0.01, rail=1.1, lost=True,
                flips=(3, 5))  # fmt: skip
WORDS = {"tanh": math.tanh, "sqrt": math.sqrt, "abs": abs, "cos": math.cos, "sin": math.sin, "exp": math.exp}
MEMORY = {"hysteresis of q, reach g", "rounded hysteresis of q, reach g", "du/dt", "∫q dt", "u slewed at S, less u",
          "reading beyond ±L", "reading less lost values", "offset of two levels"}  # fmt: skip
STATE = ("x", "y", "vx", "vy", "ux", "uy", "t", "temperature")
CASES = [(axes, term) for axes in (1, 2) for term in library(axes, EXTENT)]


@pytest.mark.parametrize(("axes", "term"), CASES, ids=[f"{axes}-{term.name}" for axes, term in CASES])
def test_a_term_is_the_same_law_in_si(axes: int, term: Term) -> None:
    random = np.random.default_rng(5)
    values = random.normal(size=len(term.columns))
    found = in_si(term, values, np.full(len(values), 0.1), LENGTH, OMEGA)
    if term.form in MEMORY:
        assert found.laws == {}
        return
    assert list(found.laws) == list(found.coefficients)
    force = LENGTH if term.sense else LENGTH * OMEGA**2
    for _ in range(5):
        at = dict(zip(STATE, random.normal(size=8), strict=True))
        units = {"x": LENGTH, "y": LENGTH, "vx": LENGTH * OMEGA, "vy": LENGTH * OMEGA,
                 "ux": LENGTH * OMEGA**2, "uy": LENGTH * OMEGA**2, "t": 1.0 / OMEGA, "temperature": 1.0}  # fmt: skip
        si = {name: value * units[name] for name, value in at.items()}
        rest = found.threshold["v0"].value if "v0" in found.threshold else math.nan
        given = (
            WORDS
            | {"sign": lambda speed, rest=rest: math.tanh(speed / rest)}
            | si
            | {"T": si["temperature"]}
            | {name: one.value for name, one in found.threshold.items()}
        )
        for axis in range(axes):
            scaled = sum(
                value * float(column[axis].subs({sp.Symbol(name, real=True): number for name, number in at.items()}))
                for value, column in zip(values, term.columns, strict=True)
            )
            texts = [(found.coefficients[label].value, laws[axis]) for label, laws in found.laws.items()]
            said = sum(value * eval(text, {}, given) for value, text in texts if text)
            assert said == pytest.approx(scaled * force, rel=1e-9, abs=1e-12 * force)


@pytest.mark.parametrize(("axes", "term"), CASES, ids=[f"{axes}-{term.name}" for axes, term in CASES])
def test_units_are_those_that_the_law_needs(axes: int, term: Term) -> None:
    """The grammar's own check of dimensions takes law, coefficient and number inside."""
    found = in_si(term, np.ones(len(term.columns)), np.ones(len(term.columns)), LENGTH, OMEGA)
    for label, along in found.laws.items():
        text = " ".join(along)
        one = [f"c_one*({law})" if law else "" for law in along]
        keys = ("sense_x", "sense_y") if term.sense else ("force_x", "force_y")
        own = OwnEffect(
            **dict(zip(keys, one, strict=True)),
            coefficients={"c_one": OwnCoefficient(unit=found.coefficients[label].unit)},
            parameters={
                name: OwnParameter(unit=at.unit, value=at.value)
                for name, at in found.threshold.items()
                if "sign(" not in text
            },
        )
        assert own.declared("form_1").coefficients.keys() == {"c_one"}


@pytest.mark.slow
def test_another_frequency_is_another_number_and_not_another_law() -> None:
    lines = [one for one in library(2, Extent(1, 1, 1, lines=(0.3, 0.9))) if one.family == "line" and not one.sense]
    for a, b in pairwise(in_si(one, np.ones(4), np.ones(4), LENGTH, OMEGA) for one in lines):
        assert a.laws == b.laws
        assert a.threshold["w"].value == pytest.approx(0.3 * OMEGA)
        assert b.threshold["w"].value == pytest.approx(0.9 * OMEGA)
