"""The angle's error without and with what a trace found, one run over the other."""

import numpy as np

from hil.report.figures.drawing import Drawing
from hil.report.material import Floats, Material
from hil.report.numbers import prefix_for, quantity, significant
from hil.report.theme import FIRST, INK, SECOND, span_time, stacked, trace


def draw(material: Material) -> Drawing | None:
    """Error of the reported angle of the earlier run above, of this one below, each on its own scale."""
    if material.earlier is None:
        return None
    runs = [_error(material.earlier), _error(material)]
    if runs[0] is None or runs[1] is None:
        return None
    figure, panels = stacked(3.4, (1.0, 1.0))
    words, sizes = [], []
    for ax, run, colour, name in zip(panels, runs, (SECOND, FIRST), ("before", "after"), strict=True):
        assert run is not None
        t, error, scored = run
        size = float(np.sqrt(np.mean(error[scored] ** 2)))
        factor, prefix = prefix_for(float(np.max(np.abs(error[scored]))))
        trace(ax, t[scored], error[scored] * factor, colour)
        ax.axhline(0.0, color=INK, linewidth=0.6)
        ax.set_ylabel(f"{name} / {prefix}deg")
        words.append(f"{name} {quantity(size, 'deg')} rms")
        sizes.append(size)
        span_time([ax], t[scored])
    caption = f"Reported angle minus the true rotation: {', '.join(words)}. Mind the scales: they differ "
    caption += f"{significant(sizes[0] / sizes[1], 2)}-fold in rms."
    return Drawing(figure, "Angle error before and after", caption, caption)


def _error(material: Material) -> tuple[Floats, Floats, np.ndarray] | None:
    """Time (n,), angle error in degrees (n,) zeroed where scoring begins, and which instants are scored."""
    estimates, reference = material.estimates, material.reference
    if estimates is None or reference is None or "angle_rad" not in estimates:
        return None
    t = estimates.t_s[reference.rows]
    scored = material.scored(t)
    error = np.degrees(estimates["angle_rad"][reference.rows] - reference.angle_rad)
    return t, error - error[scored][0], scored
