"""Thresholds tried at half and at double: what is changed to what, and that whoever changes an answer is found."""

import json
import math
import re

import numpy as np
import pytest

from benchmarks.thresholds.change import changed, with_changes
from benchmarks.thresholds.page import page
from benchmarks.thresholds.pieces import pieces
from benchmarks.thresholds.screening import added, screen
from estimator.thresholds import THRESHOLDS, each, values

NAMES = [one.name for one in each(THRESHOLDS)]
EARLY = ("scan.parts", "choice.most")


@pytest.mark.parametrize(
    ("value", "half", "double"),
    [
        (4.0, 2.0, 8.0),
        (5, 2, 10),
        (1, 1, 2),
        (1e-4, 5e-5, 2e-4),
        (0.98, 0.99, 0.96),  # what a likeness lacks to one
        (1.1, 1.05, 1.2),  # what is allowed beyond one
        ((0.1, 0.4), (0.05, 0.2), (0.2, 0.8)),
        ((4, 20), (2, 10), (8, 40)),
    ],
)
def test_half_and_double(value, half, double):
    assert changed(value, "half") == pytest.approx(half)
    assert type(np.ravel(changed(value, "half"))[0]) is type(np.ravel(value)[0])  # a number of samples stays one
    assert changed(value, "double") == pytest.approx(double)


def test_only_those_that_are_named_are_changed():
    found = values(with_changes({"promises.minor": "double", "width.leaders": "half"}))
    expected = values(THRESHOLDS)
    expected["promises"]["minor"] *= 2
    expected["width"]["leaders"] = 2
    assert found == expected


class Stub:
    """Answers as a tracer would of which three thresholds matter, each on one record and one side."""

    def __init__(self):
        self.asked = 0

    def ask(self, changes, records, *, afresh=False):
        self.asked += 1
        assert afresh or set(EARLY).isdisjoint(changes)
        return {record: self.answer(changes, record) for record in records}

    def answer(self, changes, record):
        found = {"verdict": "adequate", "words": [], "seconds": 0.1, "early": list(EARLY)}
        found["read"] = [name for name in NAMES if record == "axes" or not name.startswith("width")]
        if record == "axes" and changes.get("width.alike") == "half":
            found["verdict"] = "unexplained"
        if record == "axis" and changes.get("scan.parts") == "double":
            found["verdict"] = "unexplained"
        if record == "axis" and changes.get("floor.away") == "double":
            found["words"] = ["finds line"]
        return found

    def end(self):
        """Nothing."""


def test_whoever_changes_an_answer_is_found_and_nobody_else():
    stub = Stub()
    found = screen(stub, NAMES, ["axes", "axis"], 1, lambda line: None)
    assert {name: list(on) for name, on in found["half"].items()} == {"width.alike": ["axes"]}
    assert {name: list(on) for name, on in found["double"].items()} == {"scan.parts": ["axis"], "floor.away": ["axis"]}
    assert found["open"] == {"half": {}, "double": {}}
    assert stub.asked < 2 * len(NAMES) / 3
    told = page(found)
    assert "axes: unexplained" in told
    assert "axis: + finds line" in told
    assert "## Open" not in told


def test_what_is_found_of_some_is_put_in_its_place_and_the_rest_stays():
    whole = screen(Stub(), NAMES, ["axes", "axis"], 1, lambda line: None)
    some = screen(Stub(), ["width.alike", "floor.away"], ["axes", "axis", "more"], 1, lambda line: None)
    some["half"] = {"floor.away": {"more": some["baseline"]["more"] | {"verdict": "new"}}}
    found = added(whole, some)
    assert set(found["baseline"]) == {"axes", "axis", "more"}
    assert set(found["read"]) == set(NAMES)
    assert found["read"]["floor.away"] == ["axes", "axis", "more"]
    assert set(found["half"]) == {"floor.away"}  # that of width.alike is none any more
    assert set(found["double"]) == {"scan.parts", "floor.away"}
    late = screen(Stub(), ["width.alike"], ["axes"], 1, lambda line: None, minutes=0.0)
    assert set(added(whole, late)["open"]["half"]) == {"width.alike"}
    assert added(added(whole, late), whole) == whole | {"baseline": whole["baseline"]}


def test_what_is_asked_of_some_records_leaves_what_was_found_on_the_others():
    whole = screen(Stub(), NAMES, ["axes", "axis"], 1, lambda line: None)
    for record, others in (("axis", {"axes"}), ("axes", set())):
        some = screen(Stub(), NAMES, [record], 1, lambda line: None)
        some["half"] = {}  # it changes nothing there any more
        found = added(whole, some)
        assert {name: set(on) for name, on in found["read"].items()} == {n: set(on) for n, on in whole["read"].items()}
        assert set(found["half"].get("width.alike", {})) == others
    late = screen(Stub(), ["width.alike"], ["axis"], 1, lambda line: None, minutes=0.0)
    waiting = whole | {"open": {"half": {"width.alike": ["axes", "axis"]}, "double": {}}}
    assert added(waiting, late)["open"]["half"]["width.alike"][0] == "axes"


def test_a_change_is_told_beside_the_answer_that_it_changes():
    """Where the answer by the thresholds as they are is another one since, as the tracer is."""
    before = screen(Stub(), NAMES, ["axes"], 1, lambda line: None)
    now = json.loads(json.dumps(before))
    now["baseline"]["axes"]["verdict"] = "another"
    found = added(before, now)
    assert found["baseline"] == before["baseline"]
    (changed_,) = found["half"]["width.alike"].values()
    assert changed_["beside"]["verdict"] == "another"
    assert changed_["verdict"] == before["half"]["width.alike"]["axes"]["verdict"]
    now["half"]["width.alike"]["axes"] = now["baseline"]["axes"] | {"words": ["seen"]}
    assert "axes: + seen" in page(added(before, now))
    assert '"beside":' not in json.dumps(added(before, before))


def test_what_time_does_not_suffice_for_is_told_as_open():
    found = screen(Stub(), NAMES, ["axes", "axis"], 1, lambda line: None, minutes=0.0)
    assert "width.alike" in {*found["open"]["half"], *found["half"]}
    assert "## Open" in page(found)


@pytest.mark.parametrize(
    ("piece", "top", "deviation"),
    # The second: 10⁴ sinc²(Δω T / 2π), T = 0.25 s, bends as 1 − (Δω T / 2)² / 3 does.
    [("a climb beside a cliff", 1.0, 0.02), ("a climb within a lobe", 900.0, math.sqrt(3e-4) / 0.125)],
)
def test_a_climb_of_a_likelihood_in_closed_form_ends_at_its_top(piece, top, deviation):
    """To a fifth of a standard deviation. What stands in for a model has all that a climb asks of one."""
    found = re.match(r"top at ([\d.]+) ", pieces()[piece]()["verdict"])
    assert abs(float(found[1]) - top) <= 0.2 * deviation
