"""The page of a data sheet: its table and its figures."""

from collections.abc import Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np

from estimator.allan.noise import TERMS
from estimator.characteristics.stretches import HARMONICS
from hil.characterising.figures import HEAD, AxisFigures, cells, headline
from hil.records.atomic import write_text
from hil.records.data_sheet import DataSheet
from hil.report import markup
from hil.report.markup import Figures
from hil.report.sensor.words import NAMES, PER_HOUR
from hil.report.theme import FIRST, INK, MUTED, SECOND, Drawing, new_figure, plain_log_ticks
from hil.report.verdict import Headline, date_of

_PARTS = 24


def write_report(folder: Path, sheet: DataSheet, told: Sequence[AxisFigures]) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path."""
    write_text(path := folder / "report.html", render(folder.name, sheet, told))
    return path


def render(made: str, sheet: DataSheet, told: Sequence[AxisFigures]) -> str:
    """The page as text; `made` is the name of its folder, which has the date."""
    numbered = Figures()
    drawn = [numbered.add(partial(draw, one)) for one in told for draw in (_allan, _line, _angle)]
    listed = markup.table("Figures of the data sheet", HEAD, [cells(row) for row in sheet.rows], (2, 3))
    sections = [
        markup.section("figures", "Data sheet", *map(markup.paragraph, sheet.remarks), listed, markup.paragraph(_HOW)),
        markup.section("drawn", "Noise, scale factor, angle", *drawn),
        markup.section("records", "Records", *(markup.paragraph(record) for record in sheet.records)),
    ]
    facts = (date_of(made), sheet.device, sheet.serial_number, f"gyrohil {version('gyrohil')}")
    return markup.page(
        kind="Gyro bench · data sheet",
        title=sheet.device,
        line=Headline(*headline(sheet)),
        key="",
        sections="".join(sections),
        facts=(fact for fact in facts if fact),
    )


_HOW = (
    "Intervals are 95 %. A figure that the records do not determine has the reason beside it; its limit is not kept. "
    "Noise is read from the overlapping Allan deviation, with the degrees of freedom of the noise at each length. "
    "Bias, scale factor, "
    "temperature and angle come from one fit to the record's stretches, whose intervals allow for correlated noise."
)


def _allan(told: AxisFigures) -> Drawing | None:
    if told.noise is None or not len(told.noise.curve) or not (told.noise.curve.deviation > 0.0).all():
        return None
    curve, fit = told.noise.curve, told.noise.fit
    figure = new_figure(3.2)
    ax = figure.subplots()
    low, high = curve.interval(0.95)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.fill_between(curve.tau_s, low * PER_HOUR, high * PER_HOUR, color=FIRST, alpha=0.18, linewidth=0)
    ax.plot(curve.tau_s, curve.deviation * PER_HOUR, "o", markersize=2.6, color=FIRST, label="record")
    ax.set_ylim(*ax.get_ylim())
    if fit is not None:
        tau = np.geomspace(fit.from_s, curve.tau_s[-1], 120)
        ax.plot(tau, fit.deviation(tau) * PER_HOUR, color=INK, linewidth=0.9, label="fit")
        for term, dashes in zip(TERMS, ((1, 1), (1, 2), (4, 2), (4, 1, 1, 1), (6, 2)), strict=True):
            if fit.coefficients[term] > 0.0:
                part = np.sqrt(fit.part(term, tau)) * PER_HOUR
                ax.plot(tau, part, color=MUTED, linewidth=0.9, dashes=dashes, label=NAMES[term][0])
    plain_log_ticks(ax.yaxis)
    ax.set_xlabel("cluster length τ / s")
    ax.set_ylabel("Allan deviation / (°/h)")
    ax.legend(loc="upper right")
    caption = "Overlapping Allan deviation of what the fit leaves; band, 95 %; lines, the terms of IEEE Std 952-1997."
    return Drawing(figure, f"Allan deviation, axis {told.axis}", caption, f"{len(curve)} cluster lengths. {caption}")


def _line(told: AxisFigures) -> Drawing | None:
    levels = None if told.line is None else told.line.levels
    if levels is None or levels.rate.size < 3:
        return None
    figure = new_figure(2.6)
    ax = figure.subplots()
    full = float(np.abs(levels.rate).max())
    off, half = (1e6 * values / full for values in (levels.response - levels.rate, levels.half))
    ax.axhline(0.0, color=MUTED, linewidth=0.7)
    ax.errorbar(np.degrees(levels.rate), off, half, fmt="o", markersize=2.6, color=FIRST, linewidth=0.8)
    ax.set_xlabel("rate / (°/s)")
    ax.set_ylabel("off the line / ppm of the largest")
    caption = "Mean output at each rate less the straight line that fits best; bars, 95 %."
    return Drawing(figure, f"Scale factor residuals, axis {told.axis}", caption, f"{levels.rate.size} rates. {caption}")


def _angle(told: AxisFigures) -> Drawing | None:
    """The rate error over the pattern's angle: means of the record, and the harmonics in the fit."""
    if told.line is None or not told.line.angles or told.stretches is None or told.stretches.pattern is None:
        return None
    pattern, fit = told.stretches.pattern, told.line.fit
    theta = 0.5 * np.arctan2(pattern[:, 3], pattern[:, 2])
    names = [f"bias_{turn}{k}" for k in HARMONICS for turn in ("cos", "sin")]
    coefficients = np.array([fit.of(name) for name in names])
    off = (fit.residual + pattern[:, : len(names)] @ coefficients) * PER_HOUR
    number = np.floor((theta / np.pi + 0.5) * _PARTS).astype(int) % _PARTS
    count = np.bincount(number, minlength=_PARTS)
    means = np.bincount(number, off, minlength=_PARTS) / np.maximum(count, 1)
    middle = np.degrees(((np.arange(_PARTS) + 0.5) / _PARTS - 0.5) * np.pi)
    figure = new_figure(2.6)
    ax = figure.subplots()
    ax.plot(middle[count > 0], means[count > 0], "o", markersize=2.6, color=FIRST, label="record")
    fine = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
    drawn = np.column_stack([turn(k * fine) for k in HARMONICS for turn in (np.cos, np.sin)]) @ coefficients
    ax.plot(np.degrees(fine), drawn * PER_HOUR, color=SECOND, linewidth=0.9, label="harmonics")
    ax.set_xlabel("pattern angle θ / °")
    ax.set_ylabel("bias / (°/h)")
    ax.legend(loc="upper right")
    caption = "Bias that depends on the pattern's angle: means of the record, and the fitted harmonics 1θ to 4θ."
    return Drawing(figure, "Angle-dependent bias", caption, f"{int((count > 0).sum())} angles. {caption}")
