"""A fixed part of `make undeclared`, on short records: what is hidden is named, and what is not, is not."""

import json
from pathlib import Path

import pytest

from benchmarks.undeclared.judging import Judgement, judge
from benchmarks.undeclared.population import Order
from benchmarks.undeclared.record import make
from hil.bench import load_bench

tracing = pytest.importorskip("hil.trace")

pytestmark = pytest.mark.slow  # closed loops, and whole traces of them

SAMPLES = 30_000


def traced(order: Order, folder: Path) -> Judgement:
    place = make(order, folder, SAMPLES)
    found = tracing.trace(place / "capture.arrow", load_bench(place / "bench.toml"), place / "traces")
    said = json.loads((found.folder / "diagnosis.json").read_text())
    return judge(json.loads((place / "truth.json").read_text()), said)


@pytest.mark.parametrize(
    "effect",
    ["cubic_stiffness", "nonreciprocal_stiffness", "dry_friction", "sense_quadratic", "sense_delay", "drive_delay"],
)
def test_an_effect_nobody_declared_is_named(effect: str, tmp_path: Path) -> None:
    judged = traced(Order("single", (effect,), 1), tmp_path)
    assert judged.verdict == "explained"
    assert judged.first_class, judged.named
    assert judged.after is not None
    assert judged.before is not None
    assert judged.after < judged.before


@pytest.mark.parametrize("number", [0, 1])
def test_nothing_hidden_nothing_named(number: int, tmp_path: Path) -> None:
    assert traced(Order("clean", (), number), tmp_path).verdict == "adequate"


@pytest.mark.parametrize("effect", ["hysteretic_stiffness", "telegraph_offset"])
def test_what_the_catalogue_lacks_gets_no_wrong_name(effect: str, tmp_path: Path) -> None:
    assert not traced(Order("outside", (effect,), 2), tmp_path).misnamed


def test_two_effects_at_once(tmp_path: Path) -> None:
    judged = traced(Order("double", ("cubic_stiffness", "sense_gain"), 0), tmp_path)
    assert judged.verdict == "explained"
    assert all(judged.right_class), judged.named
