"""report.html of a ring-down's envelope: the amplitude over time, and what the laws leave of it."""

from pathlib import Path

import numpy as np

from estimator import diagnosis as traced
from estimator.envelope.record import Envelope
from estimator.scaling import Array
from hil.numbers import count, counted, significant, unit_for
from hil.records.diagnosis import Diagnosis
from hil.report.diagnosis.page import Pictures, write_page
from hil.report.markup import Figures
from hil.report.theme import FIRST, INK, MUTED, SECOND, Drawing, legend, new_figure, span_time, stacked


def write_envelope_report(folder: Path, envelope: Envelope, found: traced.Diagnosis, diagnosis: Diagnosis) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path."""
    figures = Figures()
    pictures = Pictures(error=figures.add(lambda: envelope_figure(envelope, found, diagnosis.sense_unit)))
    seconds = f"{significant(float(envelope.time[-1]))} s"
    record = ("Record", seconds, f"{count(diagnosis.samples)} samples, {count(diagnosis.split)} of them fitted")
    return write_page(folder, diagnosis, pictures, record, seconds, declarable=False)


def envelope_figure(envelope: Envelope, found: traced.Diagnosis, unit: str) -> Drawing:
    """Amplitude and models above, what they leave below."""
    figure, (above, below) = stacked(3.6, (1.6, 1.0))
    drawn = [(found.residual_before[:, 0], FIRST, "linear damping")]
    if found.effects:
        drawn = [
            (found.residual_before[:, 0], SECOND, "linear damping"),
            (found.residual_after[:, 0], FIRST, "with what was found"),
        ]
    above.plot(envelope.time, envelope.shown, ".", color=MUTED, markersize=2.5, label="record")
    for residual, colour, name in drawn:
        above.plot(envelope.time, envelope.shown - residual, color=colour, label=name)
        below.plot(envelope.time, residual, ".", color=colour, markersize=2.5)
    below.axhline(0.0, color=INK, linewidth=0.6)
    if not envelope.logarithmic:
        above.set_yscale("log")
    span_time([above, below], envelope.time)
    above.set_ylabel(f"amplitude / {unit}")
    below.set_ylabel(f"left / {unit}")
    legend(above)
    caption = "The amplitude of the ring-down, the models of it, and what they leave. On a logarithmic scale linear "
    caption += "damping is a straight line."
    return Drawing(figure, "Envelope", caption, caption)


def write_sensor_report(folder: Path, found: traced.Diagnosis, diagnosis: Diagnosis, rate_rad_s: Array) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path. rate_rad_s (n,): the reference."""
    figures = Figures()
    pictures = Pictures(error=figures.add(lambda: sensor_residual_figure(found, rate_rad_s, diagnosis.sense_unit)))
    record = ("Record", count(diagnosis.samples), f"samples, {count(diagnosis.split)} of them fitted")
    length = counted(diagnosis.samples, "sample")
    return write_page(folder, diagnosis, pictures, record, length, declarable=False)


def sensor_residual_figure(found: traced.Diagnosis, rate_rad_s: Array, unit: str = "V") -> Drawing:
    """What the model leaves of the output, in its unit, against the rate."""
    was, now = (one[:, 0] for one in (found.residual_before, found.residual_after))
    factor, named = unit_for(float(np.nanmax(np.abs(was))), unit)
    figure = new_figure(2.7)
    ax = figure.subplots()
    drawn = [(was, FIRST, "residual")]
    if found.effects:
        drawn = [(was, SECOND, "before"), (now, FIRST, "after")]
    size = 4.0 if len(rate_rad_s) < 200 else 2.0
    for residual, colour, name in drawn:
        ax.plot(np.degrees(rate_rad_s), residual * factor, ".", color=colour, markersize=size, label=name)
    ax.axhline(0.0, color=INK, linewidth=0.6)
    ax.margins(x=0.03)
    ax.set_xlabel("rate / (deg/s)")
    ax.set_ylabel(f"output minus model / {named}")
    legend(ax)
    caption = "Output minus model at every sample, against the reference rate: the straight line V0 + S Ω leaves what "
    caption += "curves, lags or saturates."
    return Drawing(figure, "Residual against the rate", caption, caption)
