"""The missing force over what it may depend on, as small multiples."""

from typing import TYPE_CHECKING

import numpy as np

from estimator.missing_force.result import MissingForce
from hil.numbers import prefix_for
from hil.report.diagnosis.material import Material
from hil.report.diagnosis.surfaces import Panel, fast, slow
from hil.report.figures.drawing import Drawing
from hil.report.theme import FIRST, MUTED, SECOND, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROW = 2.1
_ACROSS = 3
_PLAIN = ("°", "°C", "s")  # units that take no prefix


def draw_fast(material: Material) -> Drawing | None:
    """Over displacement, velocity and drive of each axis."""
    found = material.missing_force
    if found is None:
        return None
    caption = (
        "The force per mass that the model lacks, without a name, over the displacement, velocity and drive of its own "
        "axis: means of bins, with the 95 % band of the mean, from scatter and from what is not known of the force. "
        "A straight line is left out: constants take it up. A force that is nothing lies on zero."
    )
    return _drawn(fast(found, _cycle(material, found)), "Missing force over the motion", caption)


def draw_slow(material: Material) -> Drawing | None:
    """Over orientation, amplitude, time and temperature."""
    found = material.missing_force
    if found is None:
        return None
    caption = (
        "The parts of the missing force that keep step with displacement (as stiffness does) and with velocity (as "
        "damping does), over what moves slowly: a value per four cycles, means of bins with their 95 % band."
    )
    return _drawn(slow(found, _cycle(material, found)), "Missing force over what moves slowly", caption)


def _cycle(material: Material, found: MissingForce) -> float:
    return material.sample_rate_Hz / material.resonance_Hz


def _drawn(panels: list[Panel], title: str, caption: str) -> Drawing | None:
    panels = [panel for panel in panels if panel.curves]
    if not panels:
        return None
    rows = -(-len(panels) // _ACROSS)
    across = min(len(panels), _ACROSS)
    figure = new_figure(_ROW * rows + 0.35)
    grid = figure.subplots(rows, across, sharey=True, squeeze=False)
    largest = max(float(np.max(np.abs([curve.low, curve.high]))) for panel in panels for curve in panel.curves.values())
    factor, prefix = prefix_for(largest)
    for ax, panel in zip(grid.ravel(), panels, strict=False):
        _panel(ax, panel, factor)
    for ax in grid.ravel()[len(panels) :]:
        ax.set_visible(False)
    for row in grid:
        row[0].set_ylabel(f"force / ({prefix}m/s²)")
    lines, names = grid[0][0].get_legend_handles_labels()
    figure.legend(lines, names, loc="outside upper right", ncols=2)  # wider than a panel
    return Drawing(figure, title, caption, f"Curves with bands. {caption}")


def _panel(ax: "Axes", panel: Panel, factor: float) -> None:
    spread = max(float(np.max(np.abs(curve.at))) for curve in panel.curves.values())
    across, prefix = (1.0, "") if panel.unit in _PLAIN else prefix_for(spread)
    ax.axhline(0.0, color=MUTED, linewidth=0.6)
    for (name, curve), colour in zip(panel.curves.items(), (FIRST, SECOND), strict=False):
        ax.fill_between(
            curve.at * across, curve.low * factor, curve.high * factor, color=colour, alpha=0.25, linewidth=0
        )
        ax.plot(curve.at * across, curve.mean * factor, color=colour, label=name)
    unit = f"{prefix}{panel.unit}"
    ax.set_xlabel(f"{panel.over} / {f'({unit})' if '/' in unit else unit}")
    ax.margins(x=0.03)
