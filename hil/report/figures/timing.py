"""Turnaround of every answered sample, on logarithmic scales: the tail is what matters."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from hil.numbers import count, percent, significant
from hil.records.quantiles import quantiles
from hil.records.result import Percentiles
from hil.report.material import Floats, Material
from hil.report.theme import BAD, FIRST, MUTED, Drawing, mark, new_figure, plain_log_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def turnaround_figure(material: Material) -> Drawing | None:
    """Histogram of the turnaround, with percentiles, the deadline, and a bare answer's percentiles if
    known."""
    timing = material.timing
    if timing is None:
        return None

    def parts() -> Iterator[Floats]:
        return (piece.turnaround_us[piece.turnaround_us > 0] for piece in timing.pieces())

    ranked = quantiles(parts, (0.0, 0.5, 0.99, 0.999, 1.0))
    if ranked is None:
        return None
    least, p50, p99, p999, most = ranked
    found = Percentiles(p50=p50, p99=p99, p999=p999)
    result, deadline = material.folder.result, timing.deadline_us  # which may come after the figures
    bare = None if result is None else result.bare_turnaround_us
    marks = [found.p50, found.p99, found.p999, most, least]
    marks += [deadline] if deadline else []
    marks += [bare.p50, bare.p999] if bare else []
    low, high = min(marks) / 1.3, max(marks) * 1.5
    figure = new_figure(2.5)
    ax = figure.subplots()
    edges = np.geomspace(low, high, 90)
    counts = np.sum([np.histogram(part, edges)[0] for part in parts()], axis=0)
    ax.hist(edges[:-1], edges.tolist(), weights=counts, color=FIRST, alpha=0.55, linewidth=0, log=True)
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    for value, name in ((found.p50, "p50"), (found.p99, "p99"), (found.p999, "p99.9")):
        _mark(ax, value, name, FIRST, 0)
    if bare is not None:
        for value, name in ((bare.p50, "bare p50"), (bare.p99, "bare p99"), (bare.p999, "bare p99.9")):
            _mark(ax, value, name, MUTED, 1)
    caption = f"Turnaround of {count(int(counts.sum()))} answers: {_listed(found)}."
    if deadline:
        _mark(ax, deadline, "deadline", BAD, 2 if bare is not None else 1)
        slow = percent(sum(int(np.count_nonzero(part > deadline)) for part in parts()) / int(counts.sum()), 2)
        caption += f" {slow} of these answers left the host after the deadline of {significant(deadline, 4)} µs."
    if bare is not None:
        caption += f" A bare read and write paced alike: {_listed(bare)}."
    plain_log_ticks(ax.xaxis)
    ax.yaxis.set_major_formatter(lambda value, _: count(round(value)))
    ax.set_xlabel("from sample received to answer sent / µs")
    ax.set_ylabel("answers")
    return Drawing(figure, "Turnaround", caption, f"Histogram on logarithmic scales. {caption}")


def _listed(times: Percentiles) -> str:
    return f"p50 {significant(times.p50)}, p99 {significant(times.p99)}, p99.9 {significant(times.p999)} µs"


def _mark(ax: "Axes", value_us: float, name: str, colour: str, row: int) -> None:
    """In rows, so that the names of near lines do not write over each other."""
    mark(ax, value_us, name, colour, (0, 2 + 10 * row), "center")
