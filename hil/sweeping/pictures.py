"""The figures of a campaign's report."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hil.numbers import percent, significant
from hil.report.figures.drawing import Drawing
from hil.report.theme import BAD, FIRST, MUTED, SECOND, new_figure, plain_log_ticks
from hil.sweeping.dependence import Dependence, Share
from hil.sweeping.ensemble import Floats, column
from hil.sweeping.plan import Plan

if TYPE_CHECKING:
    import pyarrow
    from matplotlib.axes import Axes

_DECADE = 10.0
_MOST_DOTS = 1500
_MOST_SHARES, _MOST_PANELS, _ACROSS = 12, 6, 3


def draw_shares(found: Dependence | None) -> Drawing | None:
    """Share of the variance by key and by pair, largest first, with intervals."""
    if found is None:
        return None
    every = sorted([*found.keys, *found.pairs], key=lambda one: -one.share)[:_MOST_SHARES]
    shown = every[::-1]
    figure = new_figure(0.9 + 0.24 * len(shown))
    ax = figure.subplots()
    place = np.arange(len(shown))
    colours = [FIRST if len(one.keys) == 1 else SECOND for one in shown]
    ax.barh(place, [100.0 * one.share for one in shown], color=colours, height=0.62)
    for k, one in enumerate(shown):
        ax.plot([100.0 * one.interval[0], 100.0 * one.interval[1]], [k, k], color=MUTED, linewidth=1.4)
    ax.set_yticks(place, [" × ".join(one.keys) for one in shown])
    ax.set_xlim(left=0.0)
    ax.set_xlabel("share of the variance / %")
    ax.grid(visible=False, axis="y")
    leading = ", ".join(f"{' × '.join(one.keys)} {percent(one.share, 0)}" for one in every[:3])
    return Drawing(
        figure,
        "What the figure depends on",
        f"Share of the variance of {'log10 of ' if found.logarithmic else ''}{found.figure} by key, and by two keys "
        "together beyond what each does alone; lines are 95 % intervals.",
        f"Bars: {leading}.",
    )


def draw_courses(plan: Plan, table: "pyarrow.Table", found: Dependence | None) -> Drawing | None:
    """The figure over the keys that matter most, a dot a run."""
    if found is None:
        return None
    shown = found.keys[:_MOST_PANELS]
    rows = -(-len(shown) // _ACROSS)
    figure = new_figure(0.3 + 1.9 * rows)
    axes = figure.subplots(rows, min(_ACROSS, len(shown)), sharey=True, squeeze=False)
    value = column(table, found.figure)
    for ax, one in zip(axes.ravel(), shown, strict=False):
        _course(ax, plan, table, one, value, logarithmic=found.logarithmic)
    for ax in axes.ravel()[len(shown) :]:
        ax.set_visible(False)
    for row in axes:
        row[0].set_ylabel(found.figure)
    return Drawing(
        figure,
        "How it depends on them",
        f"{found.figure} over the keys with the largest shares, a dot a run; lines are means of neighbouring runs.",
        "Scatter of the figure over " + ", ".join(one.keys[0] for one in shown) + ".",
    )


def _course(ax: "Axes", plan: Plan, table: "pyarrow.Table", one: Share, value: Floats, *, logarithmic: bool) -> None:
    key = next(each for each in plan.campaign.vary if each.column == one.keys[0])
    given = table[key.column].to_pylist()
    if isinstance(given[0], str | bool):
        names = sorted({str(each) for each in given})
        x = np.array([names.index(str(each)) for each in given], dtype=float)
        ax.set_xticks(range(len(names)), [name if len(name) < 14 else f"{name[:12]}…" for name in names])
        ax.set_xlim(-0.5, len(names) - 0.5)
    else:
        x = np.array(given, dtype=float)
    shown = np.linspace(0, len(x) - 1, min(len(x), _MOST_DOTS)).astype(int)  # of runs in order: of all alike
    ax.scatter(x[shown], value[shown], s=5, color=FIRST, alpha=0.45, linewidths=0)
    order = np.argsort(x, kind="stable")
    known = order[np.isfinite(value[order])]
    for part in _neighbours(x[known]):
        rows = known[part]
        mean = 10.0 ** np.mean(np.log10(value[rows])) if logarithmic else np.mean(value[rows])
        ax.plot([x[rows].min(), x[rows].max()], [mean, mean], color=BAD, linewidth=1.2)
        if x[rows].min() == x[rows].max():
            ax.plot(x[rows][0], mean, marker="_", color=BAD, markersize=10)
    if logarithmic:
        ax.set_yscale("log")
    if _wide(x):
        ax.set_xscale("log")
        plain_log_ticks(ax.xaxis)
    ax.margins(x=0.04)
    ax.set_xlabel(key.column)


def _wide(x: Floats) -> bool:
    return bool(x.min() > 0.0 and x.max() > _DECADE * x.min())


def _neighbours(x: Floats) -> Sequence[npt.NDArray[np.intp]]:
    """Parts of sorted values: each value of a few, else eight parts alike in number."""
    distinct = np.unique(x)
    if len(distinct) <= 10:
        return [np.flatnonzero(x == one) for one in distinct]
    return [part for part in np.array_split(np.arange(len(x)), 8) if len(part)]


def draw_distribution(table: "pyarrow.Table") -> Drawing | None:
    """How many runs stay below which error, of angle and rate."""
    curves = [
        (name, unit, np.sort(found[np.isfinite(found) & (found > 0.0)]))
        for name, unit in (("angle_error_rms_rad", "rad"), ("rate_error_rms_rad_s", "rad/s"))
        for found in (column(table, name),)
    ]
    curves = [one for one in curves if len(one[2]) > 1]
    if not curves:
        return None
    figure = new_figure(2.1)
    axes = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    for ax, (name, unit, values) in zip(axes, curves, strict=True):
        shown = np.linspace(0, len(values) - 1, min(len(values), _MOST_DOTS)).astype(int)
        ax.step(values[shown], 100.0 * (shown + 1) / len(values), where="post", color=FIRST)
        ax.set_xscale("log")
        ax.set_xlabel(f"{name.rsplit('_rad', 1)[0].replace('_', ' ')} / {unit}")
    axes[0].set_ylabel("runs below / %")
    medians = ", ".join(f"{name} {significant(float(np.median(values)))}" for name, _, values in curves)
    return Drawing(
        figure, "Errors of all runs", "Share of the runs whose error is below the value.", f"Medians: {medians}."
    )
