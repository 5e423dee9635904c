"""The results of a campaign beside those of an earlier one: which figures got worse, beyond what chance does.

Figures are compared by the logarithm of their size: cell by cell (the values of the varied keys), over the cells of
each value, so that no algorithm hides behind another, and over all. Runs of one seed are paired; without a shared seed
the means are compared (Welch). A figure is worse where the mean rose by more than `MATERIAL` at a family-wise error of
`CHANCE` over all of these (Holm 1979). So is one that more runs lack, or an outcome that fewer runs reach (Fisher's
exact test).
"""

import itertools
import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hil.bench.data_sheet import AT_LEAST, FIGURES
from hil.errors import InputError
from hil.numbers import typeset
from hil.records.junit import Case, junit_xml
from hil.sweeping.campaign import Campaign
from hil.sweeping.plan import Plan
from hil.sweeping.tasks import Row

if TYPE_CHECKING:
    import pyarrow

CHANCE, MATERIAL = 1e-3, 0.01
GATED = (
    "angle_error_rms_rad", "rate_error_rms_rad_s", "pattern_error_rms_rad", "turn_bias_span_rad_s",
    "control_imperfection_rms_rad", "innovation_ratio", "converged_s",
)  # fmt: skip
"""Columns of every campaign of which less is better; the figures of a data sheet come beside them."""

_COMPARED = (*GATED, *(figure.key for figure in FIGURES))
_LEAST = {figure.key for figure in FIGURES if figure.name in AT_LEAST}
_FEWEST = 2
_NAMED = 3

Cell = tuple[str, ...]
"""A point of a campaign: each varied key with its value."""


class Change(NamedTuple):
    """One figure in one cell, or in those of one value, "" being all: its relative change, 0.2 for a fifth more, with
    its 95 % interval; the chance of as much without one, after Holm; how many runs, and whether it is worse."""

    figure: str
    cell: str
    change: float
    low: float
    high: float
    chance: float
    runs: int
    worse: bool = False

    @property
    def line(self) -> str:
        where = f" at {self.cell}" if self.cell else ""
        if not math.isfinite(self.low):
            return f"{self.figure}{where}: {typeset(f'{self.change:+.0%}')} of the runs"
        change, low, high = (typeset(f"{one:+.1%}") for one in (self.change, self.low, self.high))
        return f"{self.figure}{where}: {change} ({low} to {high}) over {self.runs} runs, chance {self.chance:.1g}"


def read_baseline(place: Path, plan: Plan) -> "pyarrow.Table":
    """The rows at `place`: a Parquet file, or the folder of a campaign.  Raises InputError where they are none of this
    campaign's keys, or share no cell with it."""
    from pyarrow import ArrowException, parquet

    inner = place / "results"
    try:
        table = parquet.read_table(inner if inner.is_dir() else place, page_checksum_verification=True)
    except (OSError, ArrowException) as error:
        told = str(error).partition("\n")[0]
        raise InputError(
            f"{place}: no results of a campaign ({told:.100}); give its folder or a Parquet file"
        ) from None
    keys = ["seed", *(one.column for one in plan.campaign.vary)]
    if missing := [key for key in keys if key not in table.column_names]:
        raise InputError(f"{place}: lacks {', '.join(missing)}; give results of the same campaign")
    there = _by_cell(table, plan.campaign, ())
    planned = (plan.identity(number) for number in range(0, len(plan), plan.campaign.seeds))
    if not any(_cell(row, plan.campaign) in there for row in planned):
        raise InputError(f"{place}: no cell of this campaign is in it; give results with the same values of the keys")
    return table


def changes(new: "pyarrow.Table", old: "pyarrow.Table", campaign: Campaign) -> list[Change]:
    """Each figure that both have, in each cell that both have, in those of one value, and in all together."""
    figures = [name for name in _COMPARED if {name} <= _names(new) & _names(old)]
    mine, theirs = (_by_cell(table, campaign, figures) for table in (new, old))
    cells = [cell for cell in mine if cell in theirs]
    found = []
    for name, group in _groups(cells).items():
        found += [one for figure in figures if (one := _change(figure, name, group, mine, theirs)) is not None]
    found += [
        one
        for figure in ("outcome", *figures)
        if (one := _rarer(figure, [mine[cell] for cell in cells], [theirs[cell] for cell in cells])) is not None
    ]
    return _holm(found)


def uncompared(new: "pyarrow.Table", old: "pyarrow.Table", campaign: Campaign) -> list[str]:
    """What `changes` says nothing of, for want of runs or figures in the baseline; a sentence each."""
    mine, theirs = (_by_cell(table, campaign, ()) for table in (new, old))
    found = []
    if lacking := [", ".join(cell) for cell in mine if cell not in theirs]:
        more = ", …" if len(lacking) > _NAMED else ""
        found.append(
            f"{len(lacking)} of {len(mine)} cells: the baseline has no run at {'; '.join(lacking[:_NAMED])}{more}"
        )
    return found + [f"{one}: the baseline has none" for one in _COMPARED if _has(new, one) and not _has(old, one)]


def _has(table: "pyarrow.Table", figure: str) -> bool:
    return figure in table.column_names and any(map(_told, table[figure].to_pylist()))


def _told(value: float | None) -> bool:
    return bool(value) and math.isfinite(value or 0.0)


def _groups(cells: Sequence[Cell]) -> dict[str, list[Cell]]:
    """Cells that are looked at together, by what they have in common: each by itself, those of one value, all ("")."""
    groups = {", ".join(cell): [cell] for cell in cells}
    for value in dict.fromkeys(itertools.chain.from_iterable(cells)):
        if 1 < len(of_value := [cell for cell in cells if value in cell]) < len(cells):
            groups[value] = of_value
    return groups if len(cells) == 1 else groups | {"": list(cells)}


Cells = dict[Cell, list[dict[str, Any]]]


def _names(table: "pyarrow.Table") -> set[str]:
    return set(table.column_names)


def _by_cell(table: "pyarrow.Table", campaign: Campaign, figures: Sequence[str]) -> Cells:
    wanted = {*_keys(campaign), *figures, "seed", "outcome"}
    found: Cells = defaultdict(list)
    for row in table.select([name for name in table.column_names if name in wanted]).to_pylist():
        found[_cell(row, campaign)].append(row)
    return found


def _keys(campaign: Campaign) -> list[str]:
    return [one.column for one in campaign.vary if any(key != "bench.loop.seed" for key in one.keys)]


def _cell(row: Row, campaign: Campaign) -> Cell:
    return tuple(f"{key} {_shown(row[key])}" for key in _keys(campaign))


def _shown(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _sizes(rows: Sequence[dict[str, Any]], figure: str) -> dict[int, float]:
    """Logarithm of a figure's size by seed; of one of which more is better its negative."""
    sign = -1.0 if figure in _LEAST else 1.0
    return {row["seed"]: sign * math.log(abs(row[figure])) for row in rows if _told(row[figure])}


def _change(figure: str, cell: str, group: Sequence[Cell], mine: Cells, theirs: Cells) -> Change | None:
    """None where there are too few runs to tell."""
    from scipy.stats import t as student

    pairs: list[float] = []
    shifts, parts = [], []
    for one in group:
        here, before = _sizes(mine[one], figure), _sizes(theirs[one], figure)
        if shared := [seed for seed in here if seed in before]:
            pairs += [here[seed] - before[seed] for seed in shared]
        elif min(len(here), len(before)) >= _FEWEST:
            shifts.append(float(np.mean(list(here.values())) - np.mean(list(before.values()))))
            parts += [(np.var(list(values.values()), ddof=1) / len(values), len(values)) for values in (here, before)]
    if (pairs and shifts) or (len(pairs) < _FEWEST and not shifts):
        return None
    if pairs:
        mean, variance, free = float(np.mean(pairs)), float(np.var(pairs, ddof=1)) / len(pairs), len(pairs) - 1.0
        runs = len(pairs)
    else:
        mean, variance = float(np.mean(shifts)), float(sum(part for part, _ in parts)) / len(shifts) ** 2
        weight = sum(part**2 / (count - 1) for part, count in parts)
        free = float(sum(part for part, _ in parts) ** 2 / weight) if weight else 1.0
        runs = sum(count for _, count in parts[::2])
    sd = math.sqrt(variance)
    over = mean - math.log1p(MATERIAL)
    chance = float(student.sf(over / sd, free)) if sd > 0.0 else float(over <= 0.0)
    half = float(student.ppf(0.975, free)) * sd
    value, low, high = (math.expm1(end) for end in (mean, mean - half, mean + half))
    return Change(figure, cell, value, low, high, chance, runs)


def _rarer(figure: str, mine: Sequence[list[dict[str, Any]]], theirs: Sequence[list[dict[str, Any]]]) -> Change | None:
    """Whether fewer runs have the figure, or ran to their end; None where no fewer do."""
    from scipy.stats import fisher_exact

    def counted(cells: Sequence[list[dict[str, Any]]]) -> tuple[int, int]:
        rows = [row for cell in cells for row in cell]
        there = sum(row.get(figure) == "ran" if figure == "outcome" else row[figure] is not None for row in rows)
        return there, len(rows) - there

    here, before = counted(mine), counted(theirs)
    fall = here[0] / sum(here) - before[0] / sum(before)
    if fall >= 0.0:
        return None
    chance = float(fisher_exact([here, before], alternative="less").pvalue)
    told = "runs that ran to their end" if figure == "outcome" else f"runs that have {figure}"
    return Change(told, "", fall, -math.inf, math.inf, chance, sum(here))


def _holm(found: list[Change]) -> list[Change]:
    """With the chances and judgements of all together."""
    order = sorted(range(len(found)), key=lambda at: found[at].chance)
    adjusted, least = {}, 0.0
    for rank, at in enumerate(order):
        least = max(least, min(1.0, found[at].chance * (len(found) - rank)))
        adjusted[at] = least
    return [one._replace(chance=adjusted[at], worse=adjusted[at] < CHANCE) for at, one in enumerate(found)]


def as_junit(found: Sequence[Change], name: str) -> str:
    """A test case for each figure in each cell."""
    return junit_xml(
        [
            Case(
                f"{one.figure} {one.cell}".strip(),
                name,
                "failed" if one.worse else "good",
                None,
                (one.line,) if one.worse else (),
            )
            for one in found
        ],
        f"{name}: beside its baseline",
    )
