"""A few cycles of the part held out, measured and as the model has them, before and after."""

import numpy as np

from hil.report.diagnosis.material import Material
from hil.report.figures.drawing import Drawing
from hil.report.figures.prediction import Left, prediction_panels, window
from hil.report.theme import FIRST, SECOND


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
