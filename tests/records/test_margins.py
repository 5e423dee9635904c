"""Nothing of a figure stands outside it or over another panel, by the boxes that Matplotlib itself measures."""

from collections.abc import Callable
from itertools import combinations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hil.report.theme import drawing_style, legend, new_figure, plain_log_ticks, span_time, stacked


def over_one_another() -> Figure:
    figure, panels = stacked(3.0, (2.0, 1.0))
    for ax in panels:
        ax.plot([0.0, 30.0], [-1234.5, 6789.0], label="measured")
        ax.set_ylabel("rate / (rad/s)")
        legend(ax)
    return figure


def beside_one_another() -> Figure:
    figure = new_figure(3.4)
    for ax in figure.subplots(2, 3, sharex=True, squeeze=False).ravel():
        ax.plot([0.0, 10_000.0], [-0.000125, 0.5])
        ax.set_title("kxx / %")
        ax.set_xlabel("time / s")
    return figure


def texts_above_and_beside() -> Figure:
    figure = new_figure(2.4)
    ax = figure.subplots()
    ax.plot([10.0, 100_000.0], [1.0, 1e5])
    ax.set_xscale("log")
    plain_log_ticks(ax.xaxis)
    for row in range(3):
        ax.annotate(
            "bare p99.9", (100.0, 1.0), xycoords=ax.get_xaxis_transform(),
            xytext=(0, 2 + 10 * row), textcoords="offset points",
        )  # fmt: skip
    ax.annotate("1 170 000", (100_000.0, 1e5), xytext=(4, 0), textcoords="offset points")
    return figure


def one_panel_across_two_rows() -> Figure:
    figure = new_figure(3.0)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.25))
    plane = figure.add_subplot(grid[:, 0])
    plane.plot([-100.0, 100.0], [-100.0, 100.0])
    plane.set_aspect("equal")
    plane.set_ylabel("y / µm")
    for row in range(2):
        ax = figure.add_subplot(grid[row, 1])
        ax.plot([0.0, 30.0], [0.99, 1.01])
        ax.set_title("quadrature over energy")
    return figure


def a_legend_of_the_figure() -> Figure:
    figure = new_figure(3.0)
    panels = figure.subplots(2, 2, sharex=True, sharey=True, squeeze=False).ravel()
    (line,) = panels[0].plot([0.0, 1.0], [0.0, 1.0])
    for ax in panels:
        ax.set_title("a sensor")
    figure.legend([line], ["of all"], loc="outside upper right")
    return figure


@pytest.mark.parametrize(
    "draw",
    [over_one_another, beside_one_another, texts_above_and_beside, one_panel_across_two_rows, a_legend_of_the_figure],
)
def test_labels_have_room(draw: Callable[[], Figure]) -> None:
    with drawing_style():
        figure = draw()
        figure.draw_without_rendering()
        renderer = FigureCanvasAgg(figure).get_renderer()
        whole = figure.bbox
        boxes = [ax.get_tightbbox(renderer) for ax in figure.axes] + [key.get_window_extent() for key in figure.legends]
    for box in boxes:
        assert box is not None
        assert whole.x0 <= box.x0, box
        assert box.x1 <= whole.x1, box
        assert whole.y0 <= box.y0, box
        assert box.y1 <= whole.y1, box
    for one, other in combinations(boxes, 2):
        assert one is not None
        assert other is not None
        assert not one.overlaps(other), (one, other)


def test_a_power_of_ten_takes_the_room_of_its_digits() -> None:
    with drawing_style():
        figure = new_figure(3.0)
        ax = figure.subplots()
        ax.semilogy([0.0, 1.0], [1e-5, 1e2])
        figure.draw_without_rendering()
        assert ax.get_position().width > 0.85


def test_panels_take_most_of_a_figure() -> None:
    with drawing_style():
        figure = beside_one_another()
        figure.draw_without_rendering()
        share = sum(ax.get_position().width * ax.get_position().height for ax in figure.axes)
    assert 0.4 < share < 0.8


def test_a_record_of_one_sample_has_no_span() -> None:
    _, panels = stacked(3.0, (1.0,))
    span_time(panels, [0.25], 0.5)  # a warning would fail
    low, high = panels[0].get_xlim()
    assert low < high
