"""`python -m evaluation.measured.repeats`: how many 95 % intervals agree from repeat to repeat of measured records.

Parts of a record by others, each fitted by itself with the effects of the whole. An interval agrees where it holds the
weighted mean of the other parts, whose own interval counts; nineteen of twenty should.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.stats import beta

from estimator.chance import TWO_SIDED
from estimator.scaling import Scaling
from estimator.trace.fit import fit
from estimator.trace.free_run import FreeRun
from estimator.trace.problem import Problem
from evaluation.measured.__main__ import data_folder
from evaluation.measured.emps import FILES, motion_in
from evaluation.measured.inverse_dynamics import fit_forces
from evaluation.measured.oscillator import declared, imported, record_of

REALISATION = 8675
"""Rows of one random-phase multisine of Silverbox, its pause included; ten of them follow one another."""
SILVERBOX = ("cubic_stiffness", "constant_force", "drag", "cubic_damping", "sense_cubic", "damping_asymmetric")
FRICTION = ("dry_friction", "damping_asymmetric")
PARTS = 4


@dataclass(frozen=True)
class Repeated:
    """A coefficient from each of several repeats: values and half widths of their 95 % intervals."""

    symbol: str
    values: Sequence[float]
    halves: Sequence[float]

    @property
    def off(self) -> list[float]:
        """Of each, by how much it is off the mean of the others, in half widths of what that may be."""
        values, halves = np.array(self.values), np.array(self.halves)
        return [_beside_the_others(values, halves, place) for place in range(len(values))]

    @property
    def agree(self) -> int:
        """How many of them do."""
        return sum(abs(one) <= 1.0 for one in self.off)

    @property
    def spread(self) -> float:
        """Scatter over what the intervals say: 1 where they are right."""
        return float(TWO_SIDED * np.sqrt(np.mean(np.square(self.off))))


def _beside_the_others(values: np.ndarray, halves: np.ndarray, place: int) -> float:
    """Off the weighted mean of the others, which has an interval itself."""
    rest = np.arange(len(values)) != place
    weight = 1.0 / halves[rest] ** 2
    mean = float(np.sum(weight * values[rest]) / np.sum(weight))
    return float((values[place] - mean) / np.hypot(halves[place], 1.0 / np.sqrt(np.sum(weight))))


def share(repeated: Sequence[Repeated]) -> tuple[int, int, float, float]:
    """How many agree, of how many, and the 95 % interval of the share (Clopper and Pearson)."""
    number, agree = sum(len(one.values) for one in repeated), sum(one.agree for one in repeated)
    low = float(beta.ppf(0.025, agree, number - agree + 1)) if agree else 0.0
    high = float(beta.ppf(0.975, agree + 1, number - agree)) if agree < number else 1.0
    return agree, number, low, high


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
            made.append(Repeated(symbol, values, [TWO_SIDED * float(one.deviations[k] * abs(factor)) for one in fits]))
    return made


def emps(data: Path, work: Path) -> list[Repeated]:
    """Quarters of the first file, each by its forces."""
    capture = imported(data / FILES[0], work, "emps")
    device, _ = declared("emps")
    scaling = Scaling.of(device)
    edges = np.linspace(0, len(capture), PARTS + 1).astype(int).tolist()
    fits = [fit_forces(motion_in(capture.part(*ends)), FRICTION, scaling) for ends in pairwise(edges)]
    return [
        Repeated(symbol, *zip(*((float(one.values[k]), float(one.half_widths[k])) for one in fits), strict=True))
        for k, symbol in enumerate(fits[0].names)
    ]


def main() -> None:
    """Print each coefficient, and the share of each record and of both."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.measured.repeats", description=__doc__)
    parser.add_argument("--data", type=Path, default=data_folder(), help="folder of the records; default %(default)s")
    data, every = parser.parse_args().data, []
    with tempfile.TemporaryDirectory(prefix="gyrohil-") as work:
        for repeats in (silverbox, emps):
            found = repeats(data / repeats.__name__, Path(work))
            for one in found:
                print(f"{repeats.__name__} {one.symbol}: {one.agree} of {len(one.values)}, scatter {one.spread:.2f}")
            print(f"{repeats.__name__}: {told(found)}")
            every += found
    print(f"both: {told(every)}")


def told(repeated: Sequence[Repeated]) -> str:
    """The share in words."""
    agree, number, low, high = share(repeated)
    return f"{agree} of {number} agree, {agree / number:.1%} ({low:.0%} to {high:.0%})"


if __name__ == "__main__":
    main()
