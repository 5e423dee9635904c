"""The coefficients that were found, drawn over their own estimates."""

from types import SimpleNamespace

import pytest

from estimator.diagnosis import Interval
from hil.report.diagnosis import evidence
from hil.report.markup import inline_svg
from hil.report.theme import drawing_style


def drawn(**coefficients: Interval):
    with drawing_style():
        return evidence.intervals_figure(
            SimpleNamespace(found=SimpleNamespace(effects=[SimpleNamespace(coefficients=coefficients)]))
        )


@pytest.mark.moderate
def test_an_untold_coefficient_leaves_the_others_as_they_are() -> None:
    found = drawn(
        tlx=Interval(2e-5, 1.5e-5, 2.5e-5, "s"),
        olx=Interval(-1.1e-124, -1e-8, 1e-8, "m"),
        oly=Interval(1e-9, -6e-9, 8e-9, "m"),
    )
    (axes,) = found.figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["tlx"]
    assert axes.get_xlim() == (-0.05, 1.0 + 1.5 * 0.25)
    assert found.caption.endswith("Of olx, oly the record tells nothing.")
    assert "tlx" in inline_svg(found.figure, "k", found.title, found.alt)  # a warning of Matplotlib's is an error here


def test_where_all_are_known_nothing_is_said_of_others() -> None:
    found = drawn(k=Interval(4.0, 3.0, 5.0, "1/s"))
    assert found.caption == "Each coefficient over its own estimate, with its 95 % interval; dashed: zero, no effect."


def test_nothing_is_drawn_where_no_interval_shows() -> None:
    assert drawn(k=Interval(4.0, 3.99, 4.01, "1/s")) is None
    assert drawn(olx=Interval(1e-30, -1.0, 1.0, "m")) is None
