"""Records measured by others that have repeats within them: each by itself with the effects of the whole."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.repeats.agreement import Repeated
from estimator.chance import TWO_SIDED
from estimator.scaling import Scaling
from estimator.trace.checks import deviations
from estimator.trace.fit import fit
from estimator.trace.free_run import FreeRun
from estimator.trace.problem import Problem
from evaluation.measured.emps import FILES, motion_in
from evaluation.measured.inverse_dynamics import fit_forces
from evaluation.measured.oscillator import declared, imported, record_of

REALISATION = 8675
"""Rows of one random-phase multisine of Silverbox, its pause included; ten of them follow one another."""
SILVERBOX = ("cubic_stiffness", "constant_force", "drag", "cubic_damping", "sense_cubic", "damping_asymmetric")
FRICTION = ("dry_friction", "damping_asymmetric")
PARTS = 4


def silverbox(data: Path, work: Path) -> list[Repeated]:
    """Seven realisations of the part that was fitted, each fitted by itself."""
    capture = imported(data / "SNLS80mV.csv.gz", work, "silverbox")
    first, last = capture.segments["train"]
    record = record_of(capture)
    device, settings = declared("silverbox")
    fits = []
    for begin in range(first, last - REALISATION, REALISATION):
        part = record.part(slice(begin, begin + REALISATION))
        fits.append(fit(FreeRun(Problem(part, device, settings)), {name: {} for name in SILVERBOX}))
    made = []
    for k, symbol in enumerate(fits[0].layout.names):
        if symbol not in ("x", "vx", "phi_x"):
            factor = fits[0].layout.factor[k]
            values = [float(one.model.theta[k] * factor) for one in fits]
            halves = [TWO_SIDED * float(deviations(one)[k] * abs(factor)) for one in fits]
            made.append(Repeated("Silverbox, seven realisations", symbol, values, halves))
    return made


def emps(data: Path, work: Path) -> list[Repeated]:
    """Quarters of the first file of EMPS, each by its forces."""
    capture = imported(data / FILES[0], work, "emps")
    device, _ = declared("emps")
    scaling = Scaling.of(device)
    edges = np.linspace(0, len(capture), PARTS + 1).astype(int).tolist()
    fits = [fit_forces(motion_in(capture.part(*ends)), FRICTION, scaling) for ends in pairwise(edges)]
    return [
        Repeated(
            f"EMPS, {PARTS} parts of the first file",
            symbol,
            [float(one.values[place]) for one in fits],
            [float(one.half_widths[place]) for one in fits],
        )
        for place, symbol in enumerate(fits[0].names)
    ]
