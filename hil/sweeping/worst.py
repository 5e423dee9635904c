"""The runs that came out worst, each with the command that makes it again."""

import shlex
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hil.sweeping.ensemble import column

if TYPE_CHECKING:
    import pyarrow


class Worst(NamedTuple):
    """A run: its number, outcome, the figure, its row, and how to have it again byte for byte."""

    run: int
    outcome: str
    value: float | None
    row: dict[str, Any]
    command: str


def worst_of(table: "pyarrow.Table", figure: str, most: int, campaign: str) -> list[Worst]:
    """Runs that did not run to their end first, then by the figure's magnitude."""
    if not len(table):
        return []
    size = np.abs(column(table, figure))
    outcome = np.array(table["outcome"].to_pylist())
    rank = np.where(outcome == "ran", np.where(np.isfinite(size), size, np.inf), np.inf)
    failed = outcome != "ran"
    order = np.lexsort((np.arange(len(rank)), -rank, ~failed))[:most]
    return [_worst(table.slice(int(place), 1).to_pylist()[0], figure, campaign) for place in order]


def _worst(row: dict[str, Any], figure: str, campaign: str) -> Worst:
    return Worst(row["run"], row["outcome"], row[figure], row, replay_command(campaign, row["run"]))


def replay_command(campaign: str, run: int) -> str:
    """Makes one run again, as a run folder."""
    return f"hil sweep {shlex.quote(campaign)} --only {run}"
