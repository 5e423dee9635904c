"""The page of a comparison: every method on one record, a figure and a table."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hil.bench.data_sheet import FIGURES, SheetFigure
from hil.numbers import quantity, relative, significant
from hil.records.atomic import write_text
from hil.records.methods import MethodKind, MethodRow, Methods
from hil.records.runfolder import RunFolder
from hil.report import markup
from hil.report.markup import Figures
from hil.report.theme import FIRST, INK, MUTED, SECOND, Drawing, new_figure
from hil.report.verdict import Headline, date_of
from hil.verdict.next_step import after_comparison

Floats = npt.NDArray[np.float64]
HEAD = (
    "method", "angle error, rms", "U of the angle", "rate error, rms", "U of the rate", "stiffness error", "U",
    "damping error", "U", "settled", "diverged", "a sample", "remark",
)  # fmt: skip
SHORT = (
    "method", "angle error\nmrad", "U, k = 2\nmrad", "rate error\nmrad/s", "k error\nppm", "d error\nppm",
    "settled\ns", "diverged\ns", "a sample\nµs",
)  # fmt: skip
"""The same on a terminal of 100 columns, rms, the units in the head; U of rate, k and d are left to the page."""
NOT_GIVEN = "not given"
_COLOURS: dict[MethodKind, str] = {"observer": FIRST, "traced": FIRST, "prior art": SECOND, "bound": INK}
_WINDOWS = 160
_LABEL_IN = 0.125
"""From one label to the next: the height of a line."""
_AROUND_IN = 0.6
"""What a figure has above and below its axes."""


@dataclass(frozen=True)
class Line:
    """The angle's error (n,) [rad] over bench time (n,), of one method."""

    name: str
    kind: MethodKind
    t_s: Floats
    error: Floats


def write_report(folder: Path, found: Methods, lines: Sequence[Line], capture: Path | None = None) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path; `capture` is the file they ran on."""
    path = folder / "report.html"
    text = RunFolder(folder).bench_text
    write_text(path, render(found, lines, text, folder.name, after_comparison(folder, found, record=capture)))
    return path


def render(
    found: Methods, lines: Sequence[Line], bench_text: str = "", made: str = "", command: str | None = None
) -> str:
    """The page as text; `made` is the name of its folder, which has the date; `command` is what comes next."""
    numbered = Figures()
    tone, word, sentence = headline(found)
    sections = [
        markup.section("methods", "Methods", numbered.add(lambda: angle_error_figure(found, lines)), table(found)),
        markup.section("sheet", "Data sheet", _sheet(found)),
        markup.section("left-out", "What could not be compared", *map(markup.paragraph, found.remarks)),
        markup.section("columns", "Columns", *map(markup.paragraph, _COLUMNS)),
        markup.section("bench", "Bench file", markup.listing(bench_text)),
    ]
    start, stop = found.window_s
    facts = (
        date_of(made), f"record {found.record}", f"{significant(found.seconds, 4)} s",
        f"scored from {significant(start)} to {significant(stop)} s", f"gyrohil {version('gyrohil')}",
    )  # fmt: skip
    return markup.page(
        kind="Gyro bench · comparison of methods",
        title=f"{found.bench}: {found.record}",
        line=Headline(tone, word, sentence),
        key="",
        sections="".join(sections),
        verdict=markup.verdict((), command),
        facts=(fact for fact in facts if fact),
    )


_COLUMNS = (
    "Errors are those of the scored window, angles zero at its start; stiffness and damping at its end. U is what the "
    "method says of itself (k = 2); the methods of the prior art say nothing.",
    "Settled: from when on the angle's error stays within 20 mrad of its mean. Diverged: from when on figures are not "
    "finite, the innovation is beyond [limits] residual_safe, or the angle is off by more than a quarter of a turn for "
    "good. A sample: processor time on this machine.",
    "The bound is the posterior Cramér–Rao bound of this record by the noise and the random walk that the bench file "
    "declares; no unbiased estimator that believes these does better on the average over records.",
)


def headline(found: Methods) -> tuple[str, str, str]:
    """Tone, word, sentence: the best of ours beside the best of the prior art."""
    ours = best(found, ("observer", "traced"))
    theirs = best(found, ("prior art",))
    if ours is None or theirs is None:
        return "open", "Compared", f"{len(found.rows)} methods; without a reference there are no errors to compare"
    assert ours.angle_error_rms_rad is not None
    assert theirs.angle_error_rms_rad is not None
    ratio = theirs.angle_error_rms_rad / ours.angle_error_rms_rad if ours.angle_error_rms_rad else float("inf")
    tone = "good" if ratio > 1.0 else "slow"
    return (
        tone,
        f"{significant(ratio, 2)} ×",
        f"Best observer: {ours.name}, {quantity(ours.angle_error_rms_rad, 'rad')} rms; best of the prior art: "
        f"{theirs.name}, {quantity(theirs.angle_error_rms_rad, 'rad')}",
    )


def best(found: Methods, kinds: Sequence[MethodKind]) -> MethodRow | None:
    """The row of these kinds with the least angle error; None without a reference."""
    rows = [row for row in found.rows if row.kind in kinds and row.angle_error_rms_rad is not None]
    return min(rows, key=lambda row: row.angle_error_rms_rad or 0.0, default=None)


def cells(row: MethodRow) -> tuple[str, ...]:
    """A row as text, in the order of `HEAD`; empty where there is no such figure."""
    own = ("a run of its own",) if row.record == "its own" else ()
    return (
        row.name,
        _shown(row.angle_error_rms_rad, "rad"),
        _shown(row.angle_expanded_rad, "rad") or _unsaid(row),
        _shown(row.rate_error_rms_rad_s, "rad/s"),
        _shown(row.rate_expanded_rad_s, "rad/s"),
        _share(row.stiffness_error),
        _share(row.stiffness_expanded),
        _share(row.damping_error),
        _share(row.damping_expanded),
        "" if row.settled_s is None else f"{significant(row.settled_s)} s",
        "" if row.diverged_s is None else f"at {significant(row.diverged_s)} s",
        "" if row.cost_us is None else f"{significant(row.cost_us, 2)} µs",
        "; ".join([*own, *([row.remark] if row.remark else [])]),
    )


def short_cells(row: MethodRow) -> tuple[str, ...]:
    """A row as text, in the order of `SHORT`."""
    figures = (
        (row.angle_error_rms_rad, 1e3), (row.angle_expanded_rad, 1e3), (row.rate_error_rms_rad_s, 1e3),
        (row.stiffness_error, 1e6), (row.damping_error, 1e6), (row.settled_s, 1.0), (row.diverged_s, 1.0),
        (row.cost_us, 1.0),
    )  # fmt: skip
    angle, u, *rest = ("" if value is None else significant(factor * value) for value, factor in figures)
    return row.name, angle, u or _unsaid(row), *rest


def _unsaid(row: MethodRow) -> str:
    """Of an observer that says no uncertainty of its angle; one that lost the device has none to say."""
    return NOT_GIVEN if row.kind == "observer" and row.angle_rad is not None and row.diverged_s is None else ""


def table(found: Methods) -> str:
    caption = "Every method on one record" + (f", errors against the {found.reference}" if found.reference else "")
    return markup.table(caption, HEAD, [cells(row) for row in found.rows], range(1, 12))


def sheet_rows(found: Methods, *, short: bool = False) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the figures of a data sheet, in its units; no rows where no method has any.  short: by the
    names that the field has for them, without what depends on the angle."""
    figures = [figure for figure in FIGURES if any(figure.name in row.sheet for row in found.rows)]
    if short:
        figures = [figure for figure in figures if not figure.name.endswith("theta")]
    titles = ((figure.short, "\n") if short else (figure.title, " / ") for figure in figures)
    head = ["method", *(f"{name}{gap}({one.field.symbol})" for one, (name, gap) in zip(figures, titles, strict=True))]
    rows = [
        [row.name, *(_with_interval(figure, row.sheet.get(figure.name)) for figure in figures)]
        for row in found.rows
        if row.sheet
    ]
    return head, rows


def _with_interval(figure: SheetFigure, told: tuple[float, float, float] | None) -> str:
    if told is None:
        return ""
    value, low, high = (figure.shown(one) for one in told)
    return f"{significant(value)} ± {significant(0.5 * (high - low), 2)}"


def _sheet(found: Methods) -> str:
    head, rows = sheet_rows(found)
    return markup.table("Figures of a data sheet, 95 %", head, rows, range(1, len(head))) if rows else ""


def angle_error_figure(found: Methods, lines: Sequence[Line]) -> Drawing | None:
    """The angle's error of every method, rms over short windows, on a logarithmic scale."""
    if not lines:
        return None
    height_in = max(4.2, _AROUND_IN + _LABEL_IN * (len(lines) + 1))
    figure = new_figure(height_in)
    ax = figure.subplots()
    bound = next((row.angle_error_rms_rad for row in found.rows if row.kind == "bound"), None)
    ends: list[tuple[float, str, str]] = []
    for line in lines:
        t, level = _levels(line)
        if not t.size:
            continue
        colour = _COLOURS[line.kind]
        ax.semilogy(t, level, color=colour, linewidth=1.1 if line.kind == "observer" else 0.9, alpha=0.9)
        ends.append((float(np.log10(level[-1])), line.name, colour))
    if bound:
        ax.axhline(bound, color=INK, linewidth=0.9, dashes=(4, 3))
        ends.append((float(np.log10(bound)), "bound", INK))
    start, stop = float(min(line.t_s[0] for line in lines)), float(max(line.t_s[-1] for line in lines))
    ax.set_xlim(start, stop)
    ax.axvspan(start, found.window_s[0], color=MUTED, alpha=0.10, linewidth=0)
    low, high = np.log10(ax.get_ylim())
    ends.sort()
    shares = [(end - low) / (high - low) for end, _, _ in ends]
    for share, place, (_, name, colour) in zip(
        shares, _apart(shares, _LABEL_IN / (height_in - _AROUND_IN)), ends, strict=True
    ):
        ax.annotate(
            name, (1.0, share), xycoords="axes fraction", xytext=(1.03, place), textcoords="axes fraction",
            color=colour, fontsize=7, va="center", annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.4, "shrinkA": 1, "shrinkB": 0,
                        "relpos": (0.0, 0.5)},
        )  # fmt: skip
    ax.set_xlabel("time / s")
    ax.set_ylabel("angle error / rad")
    caption = (
        f"Error of the angle against the {found.reference}, rms over short windows, zero where scoring starts (end of "
        "the shading). Blue: observers; brown: prior art; dashed: the bound."
    )
    return Drawing(figure, "Angle error of every method", caption, f"{len(lines)} curves over time. {caption}")


def _levels(line: Line) -> tuple[Floats, Floats]:
    size = max(len(line.error) // _WINDOWS, 1)
    windows = len(line.error) // size
    with np.errstate(all="ignore"):
        square = np.mean(line.error[: windows * size].reshape(windows, size) ** 2, axis=1)
    t = line.t_s[: windows * size].reshape(windows, size).mean(axis=1)
    seen = np.isfinite(square) & (square > 0.0)
    return t[seen], np.sqrt(square[seen])


def _apart(wanted: Sequence[float], least: float) -> list[float]:
    """Places from 0 to 1 for labels that are wanted at ascending places: that far apart at least, and with the least
    squares of how far they are moved.
    """
    groups: list[tuple[float, int]] = []  # mean place of labels that touch, less the room of those below; their number
    for number, place in enumerate(wanted):
        mean, size = place - number * least, 1
        while groups and groups[-1][0] > mean:
            before, count = groups.pop()
            mean, size = (before * count + mean * size) / (count + size), count + size
        groups.append((mean, size))
    highest = 1.0 - (len(wanted) - 1) * least
    means = [min(max(mean, 0.0), highest) for mean, size in groups for _ in range(size)]
    return [mean + number * least for number, mean in enumerate(means)]


def _shown(value: float | None, unit: str) -> str:
    return "" if value is None else quantity(value, unit)


def _share(value: float | None) -> str:
    return "" if value is None else relative(value).lstrip("+")
