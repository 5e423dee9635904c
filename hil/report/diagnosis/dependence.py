"""The residual in step with the vibration, against amplitude and angle: a missing force has a shape."""

from typing import TYPE_CHECKING

import numpy as np

from estimator.scaling import Array
from hil.numbers import prefix_for
from hil.report.diagnosis.material import Material
from hil.report.figures.drawing import Drawing
from hil.report.theme import FIRST, SECOND, fit_to, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 500
_BINS = 18
_FEWEST = 5  # points to a bin
_VARIES = 0.02  # of the amplitude: below it there is nothing to show it against


def dependence_figure(material: Material) -> Drawing | None:
    """The component with the most shape before, a point per four cycles, with means of bins, and the same after."""
    before = material.demodulated(material.found.residual_before)
    after = material.demodulated(material.found.residual_after)
    if before is None or after is None:
        return None
    panels: list[tuple[str, Array]] = []
    if np.std(before.amplitude) > _VARIES * np.mean(before.amplitude):
        factor, prefix = prefix_for(float(np.mean(before.amplitude)))
        panels.append((f"amplitude / {prefix}m", before.amplitude * factor))
    if material.record.sense.shape[1] == 2 and np.ptp(before.angle) > 0.5:
        panels.append(("pattern angle θ / rad", before.angle % np.pi))
    if not panels:
        return None
    name = max(before.components, key=lambda one: max(_shape(against, before.components[one]) for _, against in panels))
    figure = new_figure(2.7)
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    series = [(before.components[name], FIRST, "residual")]
    if material.changed:
        series = [(before.components[name], SECOND, "before"), (after.components[name], FIRST, "after")]
    own = material.device.sense_unit
    factor, prefix = prefix_for(float(np.std(series[0][0]))) if own == "V" else (1.0, "")
    for ax, (label, against) in zip(axes, panels, strict=True):
        for values, colour, word in series:
            _scatter(ax, against, values * factor, colour, word)
        ax.set_xlabel(label)
        ax.margins(x=0.03)
    middle = [np.quantile(values * factor, [0.005, 0.995]) for values, _, _ in series]
    fit_to(axes[0], *middle)
    axes[0].set_ylabel(f"{prefix}{own}")
    legend(axes[-1])
    caption = (
        f"The innovation's part {name} the ellipse: a point per four cycles, lines the means of bins. "
        "What depends on the motion in a way that the model does not know makes a shape; noise alone makes none."
    )
    return Drawing(figure, "Residual against the motion", caption, f"Scatter plots. {caption}")


def _scatter(ax: "Axes", against: Array, values: Array, colour: str, word: str) -> None:
    every = max(len(against) // _POINTS, 1)
    ax.plot(against[::every], values[::every], ".", color=colour, markersize=2.6, alpha=0.5, markeredgewidth=0)
    ax.plot(*_bin_means(against, values), color=colour, label=word)


def _shape(against: Array, values: Array) -> float:
    """Variance of the means of bins: what of `values` depends on `against`."""
    return float(np.var(_bin_means(against, values)[1]))


def _bin_means(against: Array, values: Array) -> tuple[Array, Array]:
    edges = np.linspace(against.min(), against.max(), _BINS + 1)
    bins = np.clip(np.digitize(against, edges) - 1, 0, _BINS - 1)
    counts = np.bincount(bins, minlength=_BINS)
    used = counts >= min(_FEWEST, counts.max())  # of a short record none has as many
    means = [np.bincount(bins, series, _BINS)[used] / counts[used] for series in (against, values)]
    return means[0], means[1]
