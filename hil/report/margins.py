"""Where the panels of a figure stand: margins of what is written beside them, told from the length of the words.

Matplotlib's own layouts draw every label, twice, to find its box: most of what a report took.
"""

import re
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.layout_engine import LayoutEngine
from matplotlib.transforms import Bbox, ScaledTranslation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.gridspec import GridSpecBase, SubplotSpec
    from matplotlib.text import Text

_POINT = 1.0 / 72.0
_DIGIT = 0.64  # of the font's size: the width of a digit of DejaVu Sans, which few letters exceed
_LINE = 1.25
_PAD = 4.0 * _POINT
_MARKED_UP = re.compile(r"\\\w+|[${}^]")  # what Matplotlib's markup for a power of ten adds to its digits
_LEGEND = 1.9  # lines of a legend above a panel, its own padding with them


class Margins(LayoutEngine):
    """Panels of a grid, as large as their labels leave room for; labels of one column and of one row are aligned."""

    def __init__(self) -> None:
        super().__init__()
        self._adjust_compatible = False
        self._colorbar_gridspec = False

    def execute(self, fig: "Figure") -> None:
        """Place the panels and the labels of their axes."""
        panels = [(ax, spec) for ax in fig.axes if (spec := ax.get_subplotspec()) is not None]
        for grid in dict.fromkeys(spec.get_gridspec() for _, spec in panels):
            _place(fig, grid, [(ax, spec) for ax, spec in panels if spec.get_gridspec() is grid])


def _place(fig: "Figure", grid: "GridSpecBase", panels: "list[tuple[Axes, SubplotSpec]]") -> None:
    rows, columns = grid.get_geometry()
    left, right, below, above = np.zeros(columns), np.zeros(columns), np.zeros(rows), np.zeros(rows)
    beside, under = np.zeros(columns), np.zeros(rows)  # of these what the numbers take
    for ax, spec in panels:
        size = _size(ax.xaxis.label)
        column, first, last = spec.colspan.start, spec.rowspan.start, spec.rowspan.stop - 1
        along, up = (_DIGIT * size * _longest(axis) for axis in (ax.xaxis, ax.yaxis))
        over, out = _beyond(ax, fig.dpi)
        beside[column] = max(beside[column], _PAD + (_PAD + up if up else 0.0))
        under[last] = max(under[last], _PAD + (_PAD + _LINE * size if along else 0.0))
        # Half of the first and of the last number stands outside.
        left[column] = max(left[column], _label(ax.yaxis), 0.5 * along - beside[column])
        right[spec.colspan.stop - 1] = max(right[spec.colspan.stop - 1], 0.5 * along, out + _PAD)
        below[last] = max(below[last], _label(ax.xaxis))
        above[first] = max(above[first], _above(ax), over + _PAD)
    if fig.legends:
        above[0] += max(_LEGEND * _LINE * _size(ax.xaxis.label) for ax, _ in panels)
    width, height = fig.get_size_inches()
    x, wide = _spread(width, left + beside, right, grid.get_width_ratios())
    y, tall = _spread(height, above, below + under, grid.get_height_ratios())
    for ax, spec in panels:
        column, end = spec.colspan.start, spec.colspan.stop - 1
        first, last = spec.rowspan.start, spec.rowspan.stop - 1
        box = (x[column], height - y[last] - tall[last]), (x[end] + wide[end], height - y[first])
        ax.set_position(Bbox(np.array(box) / (width, height)))
        aside, down = (-beside[column], 0.0), (0.0, -under[last])
        ax.yaxis.set_label_coords(0.0, 0.5, ax.transAxes + ScaledTranslation(*aside, fig.dpi_scale_trans))
        ax.xaxis.set_label_coords(0.5, 0.0, ax.transAxes + ScaledTranslation(*down, fig.dpi_scale_trans))


def _spread(
    size: float, before: npt.NDArray[np.float64], behind: npt.NDArray[np.float64], ratios: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Beginning and length of each of the cells between these margins, which share what is left."""
    shares = np.asarray(ratios, dtype=float)
    length = max(size - before.sum() - behind.sum(), 0.1) * shares / shares.sum()
    begin = np.cumsum(before + np.concatenate([[0.0], (length + behind)[:-1]]))
    return begin, length


def _size(text: "Text") -> float:
    """Height of its letters, in."""
    return float(text.get_fontsize()) * _POINT


def _longest(axis: "Axis") -> int:
    """Letters of the longest number along an axis."""
    texts = (label.get_text() for label in axis.get_ticklabels() if label.get_visible())
    return max((len(_MARKED_UP.sub("", text)) for text in texts), default=0)


def _label(axis: "Axis") -> float:
    """What the words beside an axis take, in."""
    text = axis.label.get_text()
    return _PAD + _LINE * _size(axis.label) * (text.count("\n") + 1) if text else 0.0


def _above(ax: "Axes") -> float:
    """What stands above a panel, in."""
    size = _size(ax.title)
    titled = any(ax.get_title(where) for where in ("left", "center", "right"))
    return _PAD + size * max(_LINE * titled, _LEGEND * (ax.get_legend() is not None))


def _beyond(ax: "Axes", dots: float) -> tuple[float, float]:
    """How far the texts of a panel stand out above it and to its right, in."""
    boxes = [text.get_window_extent() for text in ax.texts]
    above = max((box.y1 - ax.bbox.y1 for box in boxes), default=0.0)
    right = max((box.x1 - ax.bbox.x1 for box in boxes), default=0.0)
    return max(above, 0.0) / dots, max(right, 0.0) / dots
