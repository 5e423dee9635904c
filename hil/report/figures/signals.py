"""What went over the wire: sensed voltages and drives, as envelopes."""

from collections.abc import Iterator

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
    names = [("sensed", "V")] + ([("drive", _DRIVE_UNITS[capture.drive_unit])] if capture.has_drive else [])
    figure = new_figure(0.5 + 1.2 * len(names))
    grid = figure.subplots(len(names), capture.axes, sharex=True, sharey="row", squeeze=False)
    squares = np.zeros(capture.axes * len(names))

    def parts() -> Iterator[tuple[Floats, Floats]]:
        for piece in capture.pieces():
            values = np.hstack([piece.sense_V, piece.drive] if capture.has_drive else [piece.sense_V])
            squares[:] += np.sum(values**2, axis=0)
            yield piece.t_s, values

    middle, low, high = decimate.envelopes(parts(), len(capture), 700 // capture.axes)
    words = []
    for row, (panels, (name, unit)) in enumerate(zip(grid, names, strict=True)):
        columns = slice(row * capture.axes, (row + 1) * capture.axes)
        factor, prefix = prefix_for(float(max(np.abs(low[:, columns]).max(), np.abs(high[:, columns]).max())))
        for axis, ax in enumerate(panels):
            lower, upper = (edge[:, columns][:, axis] * factor for edge in (low, high))
            ax.fill_between(middle, lower, upper, color=AXIS_COLOURS[axis], alpha=0.5, linewidth=0.4)
            ax.set_title(f"{name} {'xy'[axis]}")
        panels[0].set_ylabel(f"{prefix}{unit}")
        rms = np.sqrt(squares[columns] / len(capture))
        words.append(f"{name} {' and '.join(significant(float(value)) for value in rms)} {unit} rms")
    for ax in grid[-1]:
        ax.set_xlabel("time / s")
    figure.align_ylabels()
    last = len(capture) - 1
    span_time(list(grid.ravel()), np.array([capture.part(0, 1).t_s[0], capture.part(last, last + 1).t_s[0]]))
    caption = f"Envelopes of every sample: {'; '.join(words)}."
    return Drawing(figure, "Signals", caption, f"Envelopes over time. {caption}")
