"""What went over the wire: sensed voltages and drives, as envelopes."""

import numpy as np

from hil.report import decimate
from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material
from hil.report.numbers import prefix_for, significant
from hil.report.theme import AXIS_COLOURS, new_figure, span_time

_DRIVE_UNITS = {"mps2": "m/s²", "N": "N", "V": "V"}


def draw(material: Material) -> Drawing | None:
    """Smallest and largest value in each column of pixels, per axis."""
    capture = material.capture
    if capture is None:
        return None
    rows = [("sensed", capture.sense_V, "V")]
    if capture.has_drive:
        rows.append(("drive", capture.drive, _DRIVE_UNITS[capture.drive_unit]))
    figure = new_figure(0.5 + 1.2 * len(rows))
    grid = figure.subplots(len(rows), capture.axes, sharex=True, sharey="row", squeeze=False)
    words = []
    for panels, (name, values, unit) in zip(grid, rows, strict=True):
        factor, prefix = prefix_for(float(np.abs(values).max()))
        for axis, ax in enumerate(panels):
            span = decimate.envelope(capture.t_s, values[:, axis] * factor, 700 // capture.axes)
            ax.fill_between(*span, color=AXIS_COLOURS[axis], alpha=0.5, linewidth=0.4)
            ax.set_title(f"{name} {'xy'[axis]}")
        panels[0].set_ylabel(f"{prefix}{unit}")
        words.append(f"{name} {_rms_words(values)} {unit} rms")
    for ax in grid[-1]:
        ax.set_xlabel("time / s")
    figure.align_ylabels()
    span_time(list(grid.ravel()), capture.t_s)
    caption = f"Envelopes of every sample: {'; '.join(words)}."
    return Drawing(figure, "Signals", caption, f"Envelopes over time. {caption}")


def _rms_words(values: Floats) -> str:
    return " and ".join(significant(float(value)) for value in np.sqrt(np.mean(values**2, axis=0)))
