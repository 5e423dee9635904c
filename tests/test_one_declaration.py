"""A new effect is one declaration: what a trace does with it follows from there, and no other room names it."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp

from estimator.core.generate.header import generated
from estimator.effects import catalogue, damping, stiffness
from estimator.effects.catalogue import EFFECTS
from estimator.effects.declaration import Coefficient, Compensation, Effect, Parameter, Signal, Source
from estimator.effects.search import Search
from estimator.model.catalogue import MODELS
from estimator.model.gyro import vx, vy
from estimator.settings import ObserverSettings
from estimator.trace.candidates import candidates
from estimator.trace.problem import Problem
from tests.trace.test_watch_list import GYRO, WHITE, N, record
from tools.effects_page import entries

ROOT = Path(__file__).parents[1]
rho, turn = sp.symbols("rho turn")

RATCHET = Effect(
    name="ratchet",
    number=len(EFFECTS),
    title="A pawl that drags one way",
    coefficients=(Coefficient(rho, "rho", 0.01, 0, -1),),
    parameters=(Parameter(turn, "turn", 1, -1, default=0.01),),
    signals=(Signal(turn, Source.PARAMETER),),
    force=(-rho * sp.Max(vx - turn, 0), -rho * sp.Max(vy - turn, 0)),
    source="of this test",
    signature="a shift while it moves",
    compensation=Compensation.CANCEL,
    search=Search.SPEEDS,
)


@pytest.fixture
def declared(monkeypatch: pytest.MonkeyPatch) -> tuple[Effect, ...]:
    """The catalogue with one effect more in a module of declarations, wherever it is asked for."""
    monkeypatch.setattr(damping, "RATCHET", RATCHET, raising=False)
    more = catalogue.collected((stiffness, damping))
    everything = (*EFFECTS, *(effect for effect in more if effect.name == "ratchet"))
    for name, module in tuple(sys.modules.items()):
        if name.startswith(("estimator.", "tools.")) and getattr(module, "EFFECTS", None) is EFFECTS:
            monkeypatch.setattr(module, "EFFECTS", everything)
    return everything


def test_the_catalogue_is_what_the_modules_declare_each_in_its_place() -> None:
    assert [effect.number for effect in EFFECTS] == list(range(len(EFFECTS)))
    assert len({effect.name for effect in EFFECTS}) == len(EFFECTS)


@pytest.mark.moderate
def test_an_effect_that_is_declared_is_tested_and_described(
    declared: tuple[Effect, ...],
) -> None:
    assert [effect.name for effect in declared][-1] == "ratchet"
    seen: Any = SimpleNamespace(innovation=WHITE, deviation=np.ones((N, 2)))
    watched = candidates(Problem(record(), GYRO, ObserverSettings()), {}, seen)
    like = {name.partition(":")[2]: given["v0"] for name, given in watched.items() if name.startswith("dry_friction:")}
    assert {label: watched[f"ratchet:{label}"] for label in like} == {label: {"turn": v0} for label, v0 in like.items()}
    assert "## ratchet" in entries()
    assert "rho" in entries()


@pytest.mark.moderate
def test_its_code_is_generated_from_the_declaration() -> None:
    without, with_it = (
        generated(MODELS[:1], effects, range(len(effects))) for effects in (EFFECTS[:1], (EFFECTS[0], RATCHET))
    )
    assert len(with_it) > len(without)


STRUCTURE = {
    # what is told of these few is the algebra of the model's own symmetries or the calibration of channels and clock
    "estimator/trace/symmetries.py",
    "estimator/uncertainty.py", "hil/bench/calibration.py", "hil/verdict/budget.py", "hil/verdict/model.py",
    "hil/toml/reading.py", "hil/importing/channels.py", "estimator/observer.py", "estimator/core/layout.py",
    "estimator/rate_sensor/surroundings.py", "hil/generating/estimator_files.py",
}  # fmt: skip


@pytest.mark.moderate
def test_no_other_room_names_an_effect() -> None:
    """Of the bench's code, an effect stands in the module that declares it (and beside look-alikes in the others)."""
    quoted = re.compile(r"[\"'](" + "|".join(effect.name for effect in EFFECTS) + r")(?=[:\"'])")
    found = {
        str(path.relative_to(ROOT))
        for room in ("estimator", "hil")
        for path in (ROOT / room).rglob("*.py")
        if path.parent.name != "effects" and quoted.search(path.read_text(encoding="utf-8"))
    }
    assert found <= STRUCTURE
