"""How figures look. Colours are drawn as fixed codes here and become the page's CSS variables in the SVG.

That is how one figure serves light paper, a dark screen and print.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.report.pixel_series import PixelSeries

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


INK, MUTED, RULE = "#1b2530", "#5c6873", "#d9dde1"
FIRST, SECOND, BAD = "#1d5fa6", "#b8561b", "#b3261e"

CSS_VARIABLE = {
    INK: "var(--ink)",
    MUTED: "var(--muted)",
    RULE: "var(--rule)",
    FIRST: "var(--first)",
    SECOND: "var(--second)",
    BAD: "var(--bad)",
}
"""Drawn colour → the page's variable that replaces it."""

AXIS_COLOURS = (FIRST, SECOND)
"""For the x and the y axis of the device."""

WIDTH_IN = 7.4

_FEW_DECADES = 300.0

_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "hil",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.labelsize": 8.5,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 5,
    "axes.titley": 1.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.facecolor": "none",
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "axes.xmargin": 0.0,
    "grid.color": RULE,
    "grid.linewidth": 0.5,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "lines.linewidth": 1.1,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "legend.handlelength": 1.6,
    "legend.borderaxespad": 0.2,
    "legend.columnspacing": 1.4,
    "figure.facecolor": "none",
}


@contextmanager
def drawing_style() -> Iterator[None]:
    """Matplotlib settings of the report, in force inside the block only."""
    import matplotlib as mpl

    with mpl.rc_context(_STYLE):
        yield


def new_figure(height_in: float) -> "Figure":
    """An empty figure of the page's width. No pyplot: nothing global, no window system."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH_IN, height_in), layout="constrained")


def stacked(height_in: float, ratios: tuple[float, ...]) -> "tuple[Figure, list[Axes]]":
    """A figure with panels over one another that share the time axis."""
    figure = new_figure(height_in)
    grid = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)
    axes: list[Axes] = list(grid[:, 0])
    axes[-1].set_xlabel("time / s")
    return figure, axes


def span_time(
    axes: "list[Axes]", t_s: npt.NDArray[np.float64] | Sequence[float], settle_s: float | None = None
) -> None:
    """Give the panels the record's time span, from first to last of `t_s`; grey what lies before the scored window."""
    start, end = float(t_s[0]), max(float(f"{t_s[-1]:.3g}"), float(t_s[-1]))
    if 0 < start < 0.02 * end:
        start = 0.0
    for ax in axes:
        if end > start:  # not of a single sample
            ax.set_xlim(start, end)
        if settle_s is not None and settle_s > start:
            ax.axvspan(start, settle_s, color=MUTED, alpha=0.10, linewidth=0)


def trace(ax: "Axes", drawn: PixelSeries, series: int, colour: str, label: str = "", factor: float = 1.0) -> None:
    """A noisy series: its envelope pale, its mean solid, so that a bias shows through the noise."""
    if drawn.crowded:
        ax.fill_between(*drawn.band(series, series, factor), color=colour, alpha=0.32, linewidth=0)
        ax.plot(drawn.mean_t_s, drawn.mean[:, series] * factor, color=colour, label=label)
    else:
        ax.plot(*drawn.line(series, factor), color=colour, linewidth=0.9, label=label)


def fit_to(ax: "Axes", *series: npt.NDArray[np.float64], margin: float = 0.12) -> None:
    """Set the value axis to what the series cover, leaving out a transient drawn elsewhere."""
    finite = [values[np.isfinite(values)] for values in series]
    low = min((values.min() for values in finite if values.size), default=0.0)
    high = max((values.max() for values in finite if values.size), default=0.0)
    pad = margin * (high - low) or 0.5 * abs(high) or 1.0
    ax.set_ylim(low - pad, high + pad)


def legend(ax: "Axes", columns: int = 4) -> None:
    """A one-line legend above the panel, right-aligned, clear of the data."""
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns)


def mark(ax: "Axes", at: float, name: str, colour: str, offset: tuple[float, float], where: str = "left") -> None:
    """A vertical line, dotted where it is pale, with its name at the top, `offset` points aside."""
    ax.axvline(at, color=colour, linewidth=0.8, dashes=(1, 2) if colour == MUTED else (4, 3))
    ax.annotate(
        name, (at, 1.0), xycoords=ax.get_xaxis_transform(), xytext=offset, textcoords="offset points", color=colour,
        fontsize=8, ha=where,
    )  # fmt: skip


def plain_log_ticks(axis: "Axis") -> None:
    """Ticks at 1, 2, 5 of each decade (of many, at 1 only), written out: 200, not 2 × 10²."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _FEW_DECADES * low else (1.0,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


class Drawing(NamedTuple):
    """A figure, and its words: title, caption for all, description for those who do not see it."""

    figure: "Figure"
    title: str
    caption: str
    alt: str
