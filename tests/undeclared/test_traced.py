"""A fixed part of `make undeclared`, on short records: what is hidden is named, and what is not, is not."""

import json
from pathlib import Path
from typing import Any

import pytest

from estimator.side_by_side import WORKERS
from estimator.trace.problem import Problem
from evaluation.undeclared.judging import Judgement, judge
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import make
from hil.bench import load_bench
from hil.inputs.captured import control_of
from hil.inputs.declared import device_of, observer_settings_of
from hil.records.capture import read_capture
from hil.records.diagnosis import to_model

engine = pytest.importorskip("estimator.trace.trace")
tracing = pytest.importorskip("hil.tracing.trace")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # closed loops, and whole traces of them

SAMPLES = 24_000


def said_of(place: Path) -> dict[str, Any]:
    """What `hil trace` says of a record, less its report."""
    capture, bench = read_capture(place / "capture.arrow"), load_bench(place / "bench.toml")
    found = engine.trace(
        Problem(
            tracing.record_of(capture),
            device_of(bench),
            observer_settings_of(bench),
            control_of(bench, capture),
        ),
        split=round(0.6 * SAMPLES),
    )
    said: dict[str, Any] = json.loads(to_model(found, record="", bench="").model_dump_json(by_alias=True))
    return said


def traced(order: Order, folder: Path) -> Judgement:
    """Record, trace, judge."""
    place = make(order, folder, SAMPLES)
    return judge(json.loads((place / "truth.json").read_text()), said_of(place))


@pytest.mark.long
@pytest.mark.parametrize(
    "effect",
    ["cubic_stiffness", "nonreciprocal_stiffness", "dry_friction", "sense_quadratic", "sense_delay", "drive_delay"],
)
def test_an_effect_nobody_declared_is_named(effect: str, tmp_path: Path) -> None:
    judged = traced(Order("single", (effect,), 1, draw=2), tmp_path)
    assert judged.verdict == "explained"
    assert judged.first_class, judged.named
    assert judged.after is not None
    assert judged.before is not None
    assert judged.after < judged.before


@pytest.mark.long
@pytest.mark.parametrize("effect", ["interference", "sense_clipping"])
def test_what_was_searched_for_lies_in_its_interval(effect: str, tmp_path: Path) -> None:
    judged = traced(Order("single", (effect,), 0, draw=2), tmp_path)
    assert judged.first_class, judged.named
    if judged.first_member:
        assert {"omega", "level"} & judged.covered.keys()
    assert {symbol: error for symbol, error in judged.error.items() if abs(error) > 1.3} == {}


@pytest.mark.long
def test_what_is_said_hangs_on_no_number_of_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit: candidates, a search for a parameter, what is held out, look-alikes and the angle's bound."""
    place = make(Order("single", ("sense_clipping",), 0, draw=2), tmp_path, SAMPLES)
    told = []
    for number in ("1", "3"):
        monkeypatch.setenv(WORKERS, number)
        told.append(said_of(place))
    assert told[0] == told[1]
    assert told[0]["effects"]


@pytest.mark.long
def test_what_cannot_be_undone_is_bounded(tmp_path: Path) -> None:
    said = said_of(make(Order("single", ("cubic_stiffness",), 1, draw=2), tmp_path, SAMPLES))
    (found,) = said["effects"]
    assert 0.0 < found["angle_bound_rad"] < 0.1 * said["angle_moved_rad"]
    held_out = said["held_out"]
    assert held_out["after"]["simulation_rmse"] < held_out["before"]["simulation_rmse"]
    assert len(said["reasons"]) == 3  # of the effect, of the floor, and of all others
    assert "other kinds of effects were tested; none raises 2 ln L by more than chance" in said["reasons"][-1]


@pytest.mark.beyond(1)
@pytest.mark.parametrize("number", [0, 1])
def test_nothing_hidden_nothing_named(number: int, tmp_path: Path) -> None:
    assert traced(Order("clean", (), number, draw=2), tmp_path).verdict == "adequate"


@pytest.mark.beyond(1)
@pytest.mark.parametrize("effect", ["telegraph_offset", "hysteretic_stiffness"])
def test_what_the_catalogue_lacks_gets_no_wrong_name(effect: str, tmp_path: Path) -> None:
    assert not traced(Order("outside", (effect,), 2, draw=2), tmp_path).misnamed


@pytest.mark.long
def test_two_effects_at_once(tmp_path: Path) -> None:
    judged = traced(Order("double", ("cubic_stiffness", "sense_gain"), 0, draw=2), tmp_path)
    assert judged.verdict == "explained"
    assert all(judged.right_class), judged.named
