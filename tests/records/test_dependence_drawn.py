"""The drawing of a residual against the motion, of records of every length."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.report.diagnosis import dependence


@pytest.mark.slow
@pytest.mark.parametrize("points", [2, 3, 40, 4000])
def test_of_a_short_record_too_what_has_a_shape_is_drawn(points: int) -> None:
    """As few points as there are bins have a bin each."""
    amplitude = np.linspace(0.5e-4, 1.5e-4, points)
    flat, shaped = np.full(points, 1e-6), 1e-3 * (amplitude / 1e-4) ** 3
    motion = SimpleNamespace(amplitude=amplitude, angle=np.zeros(points), components={"along": flat, "across": shaped})
    material: Any = SimpleNamespace(
        found=SimpleNamespace(residual_before=None, residual_after=None),
        demodulated=lambda residual: motion,
        record=SimpleNamespace(sense=np.zeros((9, 1))),
        device=SimpleNamespace(sense_unit="V"),
        changed=False,
    )
    drawing = dependence.dependence_figure(material)
    assert drawing is not None
    assert "part across the ellipse" in drawing.caption
