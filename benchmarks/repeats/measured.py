"""Records measured by others that have repeats within them: each by itself with the effects of the whole."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.repeats.agreement import Repeated
from estimator.identification.problem import Problem
from estimator.scaling import Scaling
from estimator.trace.free_run_model import fitted
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
        fits.append(fitted(Problem(part, device, settings), SILVERBOX, None, slice(50, None)))
    effects = {effect.name: effect for _, effect in fits[0].observer.effects}
    symbols = ["kxx", "dxx", "drive_gain_x"] + [c.name for name in SILVERBOX for c in effects[name].coefficients]
    made = []
    for symbol in symbols:
        ends = np.array([one.fit.interval(symbol) for one in fits])
        values = [one.fit.value(symbol) for one in fits]
        made.append(Repeated("Silverbox, seven realisations", symbol, values, (0.5 * np.diff(ends)[:, 0]).tolist()))
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
