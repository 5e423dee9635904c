"""The report of a campaign: one page that opens offline."""

import json
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hil.numbers import count, percent, quantity, significant, with_and
from hil.records.atomic import write_text
from hil.report import markup
from hil.report.markup import Figures
from hil.report.theme import BAD, FIRST, MUTED, SECOND, Drawing, new_figure, plain_log_ticks
from hil.report.verdict import Headline
from hil.sweeping import columns as figures
from hil.sweeping.dependence import Dependence, Share, dependence
from hil.sweeping.ensemble import Floats, Knows, Ratio, Worst, column, knows, over_bound, worst_of
from hil.sweeping.plan import Plan

if TYPE_CHECKING:
    import pyarrow
    from matplotlib.axes import Axes


_UNITS = {"_rad": "rad", "_rad_s": "rad/s", "_s": "s"}
_QUANTILES = (
    "angle_error_rms_rad", "angle_error_max_rad", "rate_error_rms_rad_s", "pattern_error_rms_rad", "nees",
    "innovation_ratio", "coverage", "converged_s", "angle_expanded_rad",
)  # fmt: skip
_MOST_PAIRS = 10
_PREDICTS = 0.3
"""Below that the shares are of a fit that says little."""

_READ = """\
import pandas as pd; pd.read_parquet("{folder}/results")
import polars as pl; pl.read_parquet("{folder}/results/**/*.parquet")
duckdb -c "select * from read_parquet('{folder}/results/*/*.parquet')"
"""


def write_report(plan: Plan, folder: Path, table: "pyarrow.Table") -> Path:
    """Write FOLDER/report.html of the rows that there are; returns its path."""
    path = folder / "report.html"
    write_text(path, render(plan, folder, table))
    return path


def render(plan: Plan, folder: Path, table: "pyarrow.Table") -> str:
    figure = plan.campaign.report.figure
    found = dependence(plan, table, figure)
    worst = worst_of(table, figure, plan.campaign.report.worst, plan.called)
    ratios, honesty = over_bound(table), knows(table) if plan.campaign.each.drawn_initial else None
    numbered = Figures()
    outcomes = Counter(table["outcome"].to_pylist())
    sections = [
        markup.section(
            "depends",
            "What the error depends on",
            _fit(plan, found),
            numbered.add(lambda: draw_shares(found)),
            _keys(found),
            _pairs(found),
            numbered.add(lambda: draw_courses(plan, table, found)),
        ),
        markup.section("worst", "Worst runs", _worst(worst, figure, plan)),
        markup.section("errors", "All runs", _quantiles(table), numbered.add(lambda: draw_distribution(table))),
        markup.section("bound", "Beside the bound", _ratios(ratios)),
        markup.section("honesty", "Does the observer know how wrong it is?", _knows(honesty)),
        markup.section("ended", "Runs that did not run to their end", _outcomes(table)),
        markup.section("data", "The data", markup.listing(_READ.format(folder=folder)), _columns(plan)),
        markup.section("campaign", "Campaign as run", markup.listing(_as_run(plan))),
    ]
    tone, word, sentence = _headline(plan, table, outcomes, found)
    return markup.page(
        kind="Gyro bench · campaign",
        title=plan.campaign.name,
        line=Headline(tone, word, sentence),
        key=markup.key_figures(_key_figures(table, figure, ratios, honesty)),
        sections="".join(sections),
        facts=(
            f"scenario {plan.campaign.scenario}",
            f"bench {plan.campaign.bench}",
            f"{plan.campaign.design.kind.replace('_', ' ')}",
            f"seed {plan.campaign.seed}",
            f"gyrohil {version('gyrohil')}",
        ),
    )


def _headline(
    plan: Plan, table: "pyarrow.Table", outcomes: "Counter[str]", found: Dependence | None
) -> tuple[str, str, str]:
    left = len(plan) - len(table)
    if left:
        return "open", "Under way", f"{count(len(table))} of {count(len(plan))} runs are done"
    others = len(table) - outcomes["ran"]
    said = f"{count(len(table))} runs are done"
    if found is not None and (clear := [one for one in found.keys if one.clear]):
        said += f"; {found.figure} depends mostly on {with_and([one.keys[0] for one in clear[:3]])}"
    if others:
        return "open", "Complete", f"{said}; {count(others)} of them did not run to their end"
    return "good", "Complete", said


def _key_figures(
    table: "pyarrow.Table", figure: str, ratios: list[Ratio], honesty: Knows | None
) -> list[tuple[str, str, str]]:
    values = column(table, figure)
    values = values[np.isfinite(values)]
    entries = []
    if values.size:
        entries.append(("Median", _quantity(float(np.median(values)), figure), figure))
        entries.append(("Worst", _quantity(float(np.abs(values).max()), figure), f"of {count(values.size)} runs"))
    entries += [
        (f"Over the bound: {one.what.split(',')[0]}", f"{significant(one.ratio)} ×", "rms, at the end")
        for one in ratios
        if one.what.endswith("at the end")
    ]
    if honesty is not None:
        low, high = honesty.nees_band
        entries.append(("NEES per entry", significant(honesty.nees), f"band {low:.3f} … {high:.3f}"))
    return entries


def _fit(plan: Plan, found: Dependence | None) -> str:
    if found is None:
        if not plan.campaign.vary:
            return markup.paragraph("No key was varied: the runs differ by their seeds alone.")
        return markup.paragraph("Too few runs have the figure, or it is the same in all: nothing can be divided.")
    said = (
        f"Of the variance of {'log10 of ' if found.logarithmic else ''}{found.figure} over {count(found.rows)} runs "
        f"the fit explains {percent(found.explained)}. Of the variance of runs that it was not fitted to it predicts "
        f"{percent(found.predicted)}."
    )
    if found.left_out:
        said += f" {count(found.left_out)} runs have no such figure and are left out."
    if found.between_seeds is not None:
        said += f" Between runs of one point, which differ by their seeds, there is {percent(found.between_seeds)}."
    if found.predicted < _PREDICTS:
        said += " That is little: the shares below do not explain most of the error."
    return markup.paragraph(said)


def _keys(found: Dependence | None) -> str:
    if found is None:
        return ""
    rows = [
        (
            one.keys[0],
            percent(one.share),
            _interval(one.interval),
            "" if one.first is None else _quantity(one.first, found.figure),
            "" if one.last is None else _quantity(one.last, found.figure),
        )
        for one in found.keys
    ]
    head = ("key", "share", "95 % interval", "lowest third", "highest third")
    return markup.table(f"Keys, and the mean of {found.figure} at their ends, by the fit", head, rows, (1, 2, 3, 4))


def _pairs(found: Dependence | None) -> str:
    clear = [] if found is None else [one for one in found.pairs if one.clear][:_MOST_PAIRS]
    if not clear:
        return ""
    rows = [(" × ".join(one.keys), percent(one.share), _interval(one.interval)) for one in clear]
    return markup.table(
        "Two keys together, beyond what each does alone", ("keys", "share", "95 % interval"), rows, (1, 2)
    )


def _interval(interval: tuple[float, float]) -> str:
    return f"{percent(interval[0])} … {percent(interval[1])}"


def _worst(worst: list[Worst], figure: str, plan: Plan) -> str:
    names = [one.column for one in plan.campaign.vary]
    rows = [
        (
            str(one.run),
            "–" if one.value is None else _quantity(one.value, figure),
            one.outcome if one.row["reason"] is None else f"{one.outcome}: {one.row['reason']}",
            ", ".join(f"{name} {_shown(one.row[name])}" for name in names),
            one.command,
        )
        for one in worst
    ]
    caption = f"By {figure}; each command makes the run again, byte for byte, and says so"
    return markup.table(caption, ("run", figure, "outcome", "keys", "command"), rows, (1,)) if rows else ""


def _shown(value: object) -> str:
    return significant(value) if isinstance(value, float) else str(value)


def _quantiles(table: "pyarrow.Table") -> str:
    rows = []
    for name in _QUANTILES:
        values = column(table, name)
        values = np.abs(values[np.isfinite(values)])
        if values.size:
            low, middle, high = np.percentile(values, (5, 50, 95))
            told = [_quantity(float(value), name) for value in (low, middle, high, values.max())]
            rows.append((name, *told, count(values.size), figures.FIGURES[name][1]))
    head = ("figure", "5 %", "median", "95 %", "largest", "runs", "")
    return markup.table("What the runs came to", head, rows, (1, 2, 3, 4, 5)) if rows else ""


def _ratios(ratios: list[Ratio]) -> str:
    rows = [
        (one.what, f"{one.ratio:.3f}", f"{one.interval[0]:.3f} … {one.interval[1]:.3f}", count(one.runs))
        for one in ratios
    ]
    caption = "Error over the posterior Cramér–Rao bound of the same record, root mean square over the runs"
    return markup.table(caption, ("error", "over bound", "95 % interval", "runs"), rows, (1, 2, 3)) if rows else ""


def _knows(found: Knows | None) -> str:
    if found is None:
        return ""
    low, high = found.nees_band
    inside = "inside" if low <= found.nees <= high else "outside"
    said = (
        f"NEES at the end of {count(found.runs)} runs, per entry of {found.entries}: {found.nees:.4f}, {inside} the "
        f"band {low:.4f} … {high:.4f} in which an honest observer's lies in 95 of 100 campaigns."
    )
    least, most = found.held_band
    rows = [(name, percent(held), "" if least <= held <= most else "outside") for name, held in found.held.items()]
    caption = f"Runs whose 95 % interval holds the truth at the end; expected {percent(least)} … {percent(most)}"
    return markup.paragraph(said) + markup.table(caption, ("state", "held", ""), rows, (1,))


def _outcomes(table: "pyarrow.Table") -> str:
    pairs = zip(table["outcome"].to_pylist(), table["reason"].to_pylist(), strict=True)
    told = Counter((outcome, reason or "") for outcome, reason in pairs if outcome != "ran")
    rows = [(outcome, count(number), reason) for (outcome, reason), number in told.most_common(20)]
    return markup.table("Outcome and reason", ("outcome", "runs", "reason"), rows, (1,)) if rows else ""


def _columns(plan: Plan) -> str:
    varied = [(one.column, figures.kind_of(one), ", ".join(one.keys)) for one in plan.campaign.vary]
    own = {**figures.IDENTITY, **figures.FIGURES}
    rows = varied + [(name, kind, meaning) for name, (kind, meaning) in own.items()]
    caption = "Columns, beside error_… and sd_… of each state at the end"
    return markup.table(caption, ("column", "type", "meaning"), rows)


def _as_run(plan: Plan) -> str:
    return json.dumps(plan.campaign.model_dump(mode="json", exclude_none=True), indent=1, ensure_ascii=False)


def _quantity(value: float, name: str) -> str:
    unit = next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")
    return quantity(value, unit) if unit else significant(value)


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
