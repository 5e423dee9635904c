"""How much each candidate explains: the gain of those that were fitted, beside the predicted gain of the others."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from estimator import diagnosis as traced
from estimator.diagnosis import Interval
from hil.numbers import count, percent, prefix_for, quantity, significant
from hil.records import diagnosis as written
from hil.report.diagnosis.material import Material
from hil.report.figures.signals import Left, prediction_panels, window
from hil.report.figures.spectrum import mark_multiples
from hil.report.theme import FIRST, INK, MUTED, SECOND, Drawing, legend, new_figure, plain_log_ticks, span_time, stacked

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_MOST = 14
_NAMED, _FITTED, _UNFITTED = "named", "fitted, not named", "not fitted"
_LOOKS: dict[str, dict[str, Any]] = {
    _NAMED: {"facecolor": FIRST, "alpha": 0.8},
    _FITTED: {"facecolor": MUTED, "alpha": 0.8},
    _UNFITTED: {"facecolor": "none", "edgecolor": MUTED, "hatch": "/////", "linewidth": 0.8},
}
_SAYS = {
    _NAMED: "Blue: the named effect, with the gain in log-likelihood of the observer that includes it",
    _FITTED: "Grey: fitted candidates that are not named, with their gain when they were last fitted",
    _UNFITTED: "Hatched: candidates that were not fitted, with the gain that a score test of the residual predicts",
}


class Bar(NamedTuple):
    """A candidate: its name, what it gained or would gain, and its group."""

    name: str
    size: float
    group: str


def evidence_figure(material: Material) -> Drawing | None:
    """Horizontal bars of the gain in log-likelihood, in groups: the gain of a fitted model is no predicted gain."""
    bars = bars_of(material.found)
    if len(bars) < 2:
        return None
    figure = new_figure(0.75 + 0.21 * len(bars))
    ax = figure.subplots()
    draw_bars(ax, bars)
    groups = [group for group in _LOOKS if any(bar.group == group for bar in bars)]
    caption = ". ".join(_SAYS[group] for group in groups) + "."
    if _UNFITTED in groups and len(groups) > 1:
        caption += " Compare lengths among fitted candidates, and among those that were not fitted, not across."
    caption += " Effects of one ambiguity group have nearly the same gain, and chance gives a few units."
    listed = "; ".join(
        f"{group}: " + ", ".join(f"{bar.name} {significant(bar.size)}" for bar in bars if bar.group == group)
        for group in groups
    )
    return Drawing(figure, "Evidence for the candidates", caption, f"Bars, {listed}. {caption}")


def bars_of(found: traced.Diagnosis | written.Diagnosis) -> list[Bar]:
    """By group, in each the largest first, as many as a figure holds; named ones as they were taken."""
    named = [Bar(effect.name, effect.evidence, _NAMED) for effect in found.effects if effect.evidence is not None]
    fitted = [Bar(one.name, one.gain, _FITTED) for one in found.rejected if one.gain is not None]
    predicted = [
        Bar(one.name, one.evidence, _UNFITTED)
        for one in found.rejected
        if one.gain is None and one.evidence is not None
    ]
    largest = [sorted(group, key=lambda bar: -bar.size) for group in (fitted, predicted)]
    return [bar for group in (named, *largest) for bar in group if math.isfinite(bar.size)][:_MOST]


def draw_bars(ax: "Axes", bars: list[Bar]) -> None:
    """Horizontal bars on a scale of powers of ten, each with its number."""
    sizes = [max(bar.size, 1.0) for bar in bars]
    rows = np.arange(len(bars))[::-1]
    for group, look in _LOOKS.items():
        ours = [at for at, bar in enumerate(bars) if bar.group == group]
        if ours:
            ax.barh(rows[ours], [sizes[at] for at in ours], height=0.62, label=group, **look)
    ax.set_xscale("log")
    ax.set_xlim(1.0, 2.5 * max(sizes))
    ax.set_yticks(rows, [bar.name.replace("_", " ") for bar in bars])
    for row, size, bar in zip(rows, sizes, bars, strict=True):
        ax.annotate(
            significant(bar.size), (size, row), xytext=(4, 0), textcoords="offset points", va="center", fontsize=8,
            color=INK,
        )  # fmt: skip
    ax.xaxis.set_major_formatter(lambda value, _: count(round(value)))
    ax.grid(False, axis="y")
    ax.set_xlabel("twice the gain of log-likelihood (fitted part)")
    legend(ax)


_WINDOWS = 240


def residual_level_figure(material: Material) -> Drawing | None:
    """rms over short windows, all axes together, on a logarithmic scale; the part held out is shaded."""
    found = material.found
    samples = len(found.residual_before)
    size = max(samples // _WINDOWS, 8)
    windows = samples // size
    if windows < 8:
        return None
    floor = np.array(found.held_out_after.noise_floor)
    time = material.record.time
    middle = time[: windows * size].reshape(windows, size).mean(axis=1)
    figure = new_figure(2.3)
    ax = figure.subplots()
    drawn = [(found.residual_before, FIRST, "residual")]
    if material.changed:
        drawn = [(found.residual_before, SECOND, "before"), (found.residual_after, FIRST, "after")]
    shown = []
    for residual, colour, name in drawn:
        scaled = (residual / floor)[: windows * size].reshape(windows, -1)
        valid = np.isfinite(scaled)
        count = np.maximum(valid.sum(axis=1), 1)
        level = np.sqrt((np.where(valid, scaled, 0.0) ** 2).sum(axis=1) / count)
        level[valid.sum(axis=1) == 0] = np.nan
        ax.semilogy(middle, level, color=colour, label=name)
        shown.append(level[np.isfinite(level) & (middle >= time[material.settled])])
    ax.axhline(1.0, color=INK, linewidth=0.9, dashes=(4, 3), label="noise floor")
    span_time([ax], time)
    start = float(time[min(found.split, samples - 1)])
    ax.axvspan(start, float(time[-1]), color=MUTED, alpha=0.10, linewidth=0)
    ax.annotate(
        "held out", (start, 0.0), xycoords=ax.get_xaxis_transform(), xytext=(5, 5), textcoords="offset points",
        color=MUTED, fontsize=8,
    )  # fmt: skip
    every = np.concatenate(shown)
    if every.size:
        ax.set_ylim(min(0.8, every.min() / 1.2), max(1.5, every.max() * 1.3))
    plain_log_ticks(ax.yaxis)
    ax.set_xlabel("time / s")
    ax.set_ylabel("rms / floor")
    legend(ax)
    before, after = found.held_out_before.ratio, found.held_out_after.ratio
    caption = f"On the held-out part (shaded) the residual is {significant(before)} × the floor"
    caption += f" before and {significant(after)} × after." if material.changed else "."
    return Drawing(figure, "Residual over time", caption, f"rms over windows of {size} samples. {caption}")


def held_out_figure(material: Material) -> Drawing | None:
    """From its middle; of a single axis by the free run, with which such a record was traced."""
    found, record = material.found, material.record
    simulated = found.free_run
    if simulated is None:
        before, after = found.residual_before[found.split :], found.residual_after[found.split :]
    else:
        before, after = simulated
    known = np.flatnonzero(np.all(np.isfinite(before), axis=1))
    if not known.size:
        return None
    size = min(window(material.sample_rate_Hz / material.resonance_Hz), len(known))
    first = int(known[(len(known) - size) // 2])
    rows = slice(first, first + size)
    left = [Left(before[rows], FIRST, "simulated" if simulated is not None else "predicted")]
    if material.changed:
        left = [Left(before[rows], SECOND, "before"), Left(after[rows], FIRST, "after")]
    whole = slice(found.split + first, found.split + first + size)
    return prediction_panels(
        record.time[whole], record.sense[whole], left, where="A few cycles of the part held out",
        unit=material.device.sense_unit, ahead=simulated is None,
    )  # fmt: skip


def held_out_spectrum_figure(material: Material) -> Drawing | None:
    """Amplitude density of the held-out part, a panel per axis, multiples of the resonance marked."""
    frequency, before, after = material.held_out_densities
    if len(frequency) < 8 or not (np.isfinite(before).all() and np.isfinite(after).all() and before.any()):
        return None
    rate, resonance = material.sample_rate_Hz, material.resonance_Hz
    axes = before.shape[1]
    floors = np.array(material.found.held_out_after.noise_floor) * np.sqrt(2.0 / rate)
    own = material.device.sense_unit
    factor, prefix = prefix_for(float(np.median(floors))) if own == "V" else (1.0, "")
    curves = [(before, FIRST, "residual")]
    if material.changed:
        curves = [(before, SECOND, "before"), (after, FIRST, "after")]
    figure, panels = stacked(0.7 + 1.75 * axes, (1.0,) * axes)
    for axis, ax in enumerate(panels):
        low, high = [], []
        for power, colour, name in curves:
            curve = np.sqrt(power[:, axis]) * factor
            ax.semilogy(frequency, curve, color=colour, linewidth=0.9, label=name)
            low.append(curve.min())
            high.append(curve.max())
        ax.axhline(floors[axis] * factor, color=INK, linewidth=0.9, dashes=(4, 3), label="noise floor")
        ax.set_ylim(min(*low, floors[axis] * factor) / 1.4, max(*high, floors[axis] * factor) * 3.0)
        plain_log_ticks(ax.yaxis)
        ax.set_ylabel(f"ν{'xy'[axis]} / ({prefix}{own}/√Hz)")
        mark_multiples(ax, resonance, 0.98 * rate / 2, most=9)
        ax.set_xlim(0, rate / 2)
    legend(panels[0])
    panels[-1].set_xlabel("frequency / Hz")
    caption = (
        "Amplitude density of the innovation on the part of the record that is held out (Welch). "
        f"Dotted: multiples of the resonance f₀ = {quantity(resonance, 'Hz', 4)}."
    )
    was, now = (significant(fit.ratio) for fit in material.fits[2:])
    told = f" before, {now} after" if material.changed else ""
    alt = f"The residual is {was} times the floor{told}."
    return Drawing(figure, "Spectrum of the residual", caption, f"{alt} {caption}")


_VISIBLE = 0.02
"""Of the estimate: half an interval that a drawing shows."""

_WIDEST = 5.0
"""Of the estimate: half an interval beside which the others still show, unlike that of a start that has waned."""


def intervals_figure(material: Material) -> Drawing | None:
    """Every coefficient that is known at all over its own estimate, so that all share one scale; none where no interval
    could be seen on it.  The table has the figures of all.
    """
    known = [
        (symbol, found)
        for effect in material.found.effects
        for symbol, found in effect.coefficients.items()
        if found.value and np.isfinite([found.low, found.high]).all() and found.high > found.low
    ]
    entries = [(symbol, found) for symbol, found in known if _half(found) < _WIDEST * abs(found.value)]
    if not any(_half(found) > _VISIBLE * abs(found.value) for _, found in entries):
        return None
    figure = new_figure(0.55 + 0.26 * len(entries))
    ax = figure.subplots()
    rows = np.arange(len(entries))[::-1]
    half = []
    for row, (_, found) in zip(rows, entries, strict=True):
        ends = sorted((found.low / found.value, found.high / found.value))
        ax.plot(ends, [row, row], color=FIRST, linewidth=2.2)
        ax.plot([1.0], [row], "o", color=FIRST, markersize=4)
        half.append((ends[1] - ends[0]) / 2.0)
        ax.annotate(
            f"± {percent(half[-1], 1 if half[-1] > 0.01 else 2)}", (ends[1], row), xytext=(6, 0),
            textcoords="offset points", va="center", fontsize=8, color=MUTED,
        )  # fmt: skip
    ax.axvline(0.0, color=MUTED, linewidth=0.9, dashes=(4, 3))
    reach = max(half)
    ax.set_xlim(min(-0.05, 1.0 - 1.2 * reach), 1.0 + max(1.5 * reach, 0.25))
    ax.set_ylim(-0.6, len(entries) - 0.4)
    ax.set_yticks(rows, [symbol for symbol, _ in entries])
    ax.grid(False, axis="y")
    ax.set_xlabel("coefficient / its estimate")
    caption = "Each coefficient over its own estimate, with its 95 % interval; dashed: zero, no effect."
    if left := [symbol for symbol, found in known if _half(found) >= _WIDEST * abs(found.value)]:
        caption += f" Of {', '.join(left)} the record tells nothing."
    return Drawing(figure, "Coefficients", caption, caption)


def _half(found: Interval) -> float:
    return 0.5 * (found.high - found.low)
