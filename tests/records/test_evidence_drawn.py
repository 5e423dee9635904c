"""The evidence for the candidates: what was carried, and what was only promised, each on a scale of its own."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgba
from matplotlib.patches import Rectangle

from estimator.diagnosis import Rejected
from hil.library import trace_figure
from hil.records.diagnosis import Diagnosis, to_model
from hil.report.diagnosis import evidence
from hil.report.markup import inline_svg
from hil.report.theme import FIRST, MUTED, Drawing, drawing_style
from tests.records.test_diagnosis import answer

CARRIED = Rejected("quintic_stiffness", "carried, it gains 850", {}, 60_000.0, 1.527e8)
LOST = Rejected("dry_friction", "carried, it gains −12", {}, 400.0, -12.0)
PROMISED = Rejected("sense_gain", "looks like what was taken", {}, 7000.0)


def drawn(*rejected: Rejected, named: bool = True) -> Drawing | None:
    effects = [SimpleNamespace(name="cubic_stiffness", evidence=1.6e8)] if named else []
    found: Any = SimpleNamespace(found=SimpleNamespace(effects=effects, rejected=rejected))
    with drawing_style():
        return evidence.evidence_figure(found)


def bars(drawing: Drawing) -> dict[str, tuple[float, str, str | None]]:
    """By label: length, colour of the filling ("none" without) and hatching."""
    (axes,) = drawing.figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    labels = dict(zip(np.round(axes.get_yticks()), names, strict=True))
    found: dict[str, tuple[float, str, str | None]] = {}
    for bar in rectangles(axes):
        filling = to_hex(bar.get_facecolor()) if bar.get_fill() and to_rgba(bar.get_facecolor())[3] else "none"
        name = labels[round(bar.get_y() + bar.get_height() / 2)]
        found[name] = bar.get_width(), filling, bar.get_hatch()
    return found


def rectangles(axes: Axes) -> list[Rectangle]:
    return [bar for bar in axes.patches if isinstance(bar, Rectangle)]


@pytest.mark.moderate
def test_what_was_carried_has_the_length_it_gained_there() -> None:
    found = drawn(CARRIED, LOST, PROMISED)
    assert found is not None
    told = bars(found)
    assert told["cubic stiffness"] == (1.6e8, FIRST, None)
    assert told["quintic stiffness"] == (1.527e8, MUTED, None)
    assert told["dry friction"][0] == 1.0  # a loss has no length on such a scale: the number beside it says it
    assert list(told) == ["cubic stiffness", "quintic stiffness", "dry friction", "sense gain"]
    assert "−12" in inline_svg(found.figure, "k", found.title, found.alt)


def test_what_was_only_expected_is_hatched_and_named_in_legend_and_alt() -> None:
    found = drawn(CARRIED, PROMISED)
    assert found is not None
    length, filling, hatch = bars(found)["sense gain"]
    assert (length, filling) == (7000.0, "none")
    assert hatch
    (axes,) = found.figure.axes
    shown = axes.get_legend()
    assert shown is not None
    assert [text.get_text() for text in shown.get_texts()] == ["named", "fitted, not named", "not fitted"]
    for text in (found.caption, found.alt):
        assert "not fitted" in text
        assert "fitted, not named" in text or "Grey: fitted" in text
    assert "not across" in found.caption


def test_a_caption_tells_only_of_what_is_drawn() -> None:
    found = drawn(PROMISED, Rejected("sense_delay", "nothing is left", {}, 20.0), named=False)
    assert found is not None
    assert "Blue" not in found.caption
    assert "Grey" not in found.caption
    assert "not across" not in found.caption


@pytest.mark.parametrize("rejected", [(), (Rejected("sense_gain", "no model"),)])
def test_one_bar_is_no_comparison(rejected: tuple[Rejected, ...]) -> None:
    assert drawn(*rejected) is None


def test_the_figure_of_a_notebook_tells_them_apart_too() -> None:
    found = to_model(answer(), record="ride", bench="S-test")
    written = [
        {"name": one.name, "reason": one.reason, "evidence": one.evidence, "gain": one.gain}
        for one in (CARRIED, PROMISED)
    ]
    known = Diagnosis.model_validate(found.model_dump(by_alias=True) | {"rejected": written})
    _, axes = trace_figure.trace_figure(known).axes
    assert [bar.get_hatch() is None for bar in rectangles(axes)] == [True, True, False]
    assert sorted(bar.get_width() for bar in rectangles(axes)) == [7000.0, 1.6e5, 1.527e8]
    shown = axes.get_legend()
    assert shown is not None
    assert len(shown.get_texts()) == 3
