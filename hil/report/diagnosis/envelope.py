"""report.html of a ring-down's envelope: the amplitude over time, and what the laws leave of it."""

from pathlib import Path

from estimator import diagnosis as traced
from estimator.envelope.record import Envelope
from hil.numbers import count, significant
from hil.records.diagnosis import Diagnosis
from hil.report.diagnosis.page import Pictures, write_page
from hil.report.figures.drawing import Drawing
from hil.report.numbering import Figures
from hil.report.theme import FIRST, INK, MUTED, SECOND, legend, span_time, stacked


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
