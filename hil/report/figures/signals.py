"""What went over the wire: sensed voltages and drives, as envelopes."""

import math
from collections.abc import Iterator

import numpy as np

from hil.numbers import prefix_for, significant, unit_for
from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material
from hil.report.pixel_series import pixel_series
from hil.report.theme import AXIS_COLOURS, new_figure, span_time

_DRIVE_UNITS = {"mps2": "m/s²", "N": "N", "V": "V"}


def signals_figure(material: Material) -> Drawing | None:
    """Smallest and largest value in each column of pixels, per axis."""
    capture = material.capture
    if capture is None:
        return None
    drives = [("drive", _DRIVE_UNITS[capture.drive_unit])] if capture.has_drive else []
    names = [("sensed", capture.sense_unit), *drives]
    figure = new_figure(0.5 + 1.2 * len(names))
    titles = "xy"[: capture.axes] if capture.carrier_Hz is None else ("x, X", "y, X", "x, Y", "y, Y")
    grid = figure.subplots(len(names), len(titles), sharex=True, sharey="row", squeeze=False)

    def parts() -> Iterator[tuple[Floats, Floats]]:
        for piece in capture.pieces():
            yield piece.t_s, np.hstack([piece.sense_V, piece.drive] if capture.has_drive else [piece.sense_V])

    last = len(capture) - 1
    span = float(capture.part(0, 1).t_s[0]), float(capture.part(last, last + 1).t_s[0])
    drawn = pixel_series(parts(), span, len(capture), -math.inf, 700 // len(titles))
    words = []
    for row, (panels, (name, unit)) in enumerate(zip(grid, names, strict=True)):
        columns = range(row * len(titles), (row + 1) * len(titles))
        size = max(drawn.held.size(column) for column in columns)
        factor, label = unit_for(size, unit) if name == "sensed" else _prefixed(size, unit)
        for axis, (ax, column) in enumerate(zip(panels, columns, strict=True)):
            edges = drawn.band(column, column, factor)
            ax.fill_between(*edges, color=AXIS_COLOURS[axis % 2], alpha=0.5, linewidth=0.4)
            ax.set_title(f"{name} {titles[axis]}")
        panels[0].set_ylabel(label)
        rms = drawn.held.rms[list(columns)]
        words.append(f"{name} {' and '.join(significant(float(value)) for value in rms)} {unit} rms")
    for ax in grid[-1]:
        ax.set_xlabel("time / s")
    span_time(list(grid.ravel()), span)
    caption = f"Envelopes of every sample: {'; '.join(words)}."
    return Drawing(figure, "Signals", caption, f"Envelopes over time. {caption}")


def _prefixed(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit of a drive."""
    factor, prefix = prefix_for(size)
    return factor, prefix + unit
