"""Numbers that a page repeats are those of the code: what a calibration assumes, what tracing goes by."""

import math
import re
from pathlib import Path

import pytest

from estimator.thresholds import THRESHOLDS
from hil.bench.calibration import ASSUMED, Assumed, Calibration

DOCS = Path(__file__).parents[1] / "docs"
EXPLANATION = (DOCS / "explanation.md").read_text(encoding="utf-8")


def of_page(one: Assumed) -> str:
    if one.unit == "s":
        return f"{1e3 * one.value:g} mrad of the resonance"
    return f"{1e2 * one.value:g} %" if one.value >= 1e-3 else f"{1e6 * one.value:g} ppm"


def of_key(one: Assumed) -> str:
    if one.unit == "s":
        return of_page(one)
    return f"{one.value:g}".replace("e-0", "e-")


def test_the_explanation_lists_what_a_calibration_assumes_and_why() -> None:
    rows = [f"| {name.replace('_', ' ')} | {of_page(one)} | {one.why} |" for name, one in ASSUMED.items()]
    head = "| constant | assumed, standard | because |\n|---|---|---|\n"
    assert head + "\n".join(rows) + "\n\n" in EXPLANATION


@pytest.mark.parametrize("name", ASSUMED)
def test_a_key_of_the_calibration_says_what_is_assumed_without_it(name: str) -> None:
    one = ASSUMED[name]
    key = Calibration.model_fields[f"{name}_u{'_s' if one.unit == 's' else ''}"]
    assert " ".join((key.description or "").split()).endswith(f"without it {of_key(one)} is assumed")


def test_pages_repeat_the_thresholds_of_look_alikes_as_they_are() -> None:
    same, odds = THRESHOLDS.scan.same, THRESHOLDS.criterion.odds
    assert f"a correlation of {same:g}, the record does not say" in EXPLANATION
    assert f"2 ln {odds:g} = {2.0 * math.log(odds):.0f}." in EXPLANATION
    for page in (EXPLANATION, (DOCS / "reference" / "trace.md").read_text(encoding="utf-8")):
        told = re.findall(r"odds\s+of\s+(?:more\s+than\s+)?(\S+)\s+to\s+1\b", page)
        assert told
        assert set(told) == {f"{odds:g}"}
