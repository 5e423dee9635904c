"""The figure of a comparison: every curve has its name, beside it and on the page, however large the errors are."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.records.methods import MethodRow, Methods
from hil.report.markup import inline_svg
from hil.report.methods import Line, _apart, angle_error_figure, table
from hil.report.theme import drawing_style

FOUND = Methods(record="r", bench="b", seconds=10.0, window_s=(2.0, 10.0), reference="truth", rows=(), remarks=())


@pytest.mark.parametrize(
    ("wanted", "places"),
    [
        ([0.2, 0.8], [0.2, 0.8]),
        ([0.5, 0.5], [0.45, 0.55]),
        ([0.5, 0.5, 0.5, 0.9], [0.4, 0.5, 0.6, 0.9]),
        ([0.98, 1.0], [0.9, 1.0]),
        ([0.0, 0.0], [0.0, 0.1]),
    ],
)
def test_labels_stand_apart_and_as_near_as_they_can(wanted: list[float], places: list[float]) -> None:
    assert _apart(wanted, 0.1) == pytest.approx(places)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20).map(sorted))
def test_no_label_leaves_the_axes_or_touches_another(wanted: list[float]) -> None:
    places = _apart(wanted, 0.05)
    assert min(places) >= -1e-12
    assert max(places) <= 1.0 + 1e-12
    assert all(np.diff(places) >= 0.05 - 1e-12)


@pytest.mark.slow
def test_every_name_is_on_the_page_where_errors_are_large() -> None:
    t = np.linspace(0.0, 10.0, 400)
    lines = [Line(f"method {k}", "observer", t, 1e-3 + 10.0**k * np.exp(t)) for k in (2, 2, 2, 2, 2, 2, 1, -3)]
    with drawing_style():
        drawing = angle_error_figure(FOUND, lines)
        assert drawing is not None
        svg = inline_svg(drawing.figure, "f", "t", "a")
    _, _, width, height = map(float, re.search(r'viewBox="([^"]+)"', svg).group(1).split())
    places = re.findall(r'<text[^>]* x="([\d.]+)" y="([\d.]+)"[^>]*>method', svg)
    assert len(places) == len(lines)
    assert all(0.0 < float(x) < width and 7.0 < float(y) < height for x, y in places)


def test_a_table_of_many_columns_is_as_broad_as_the_page() -> None:
    assert '<div class="wide broad"' in table(
        FOUND.model_copy(update={"rows": (MethodRow(name="m", kind="observer", record="this"),)})
    )
