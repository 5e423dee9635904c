"""What a report is made of: the run's records, and a reference to hold them against when there is one."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from hil.records.capture import Capture
from hil.records.estimates import Estimates
from hil.records.innovation import Innovation
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.records.summary import summarise
from hil.records.timing import Timing
from hil.records.truth import Truth

Floats = npt.NDArray[np.float64]

_Record = TypeVar("_Record", Capture, Estimates, Innovation, Timing)


@dataclass(frozen=True)
class Reference:
    """Rate and its integral at those rows of the estimates where they are known."""

    name: str
    rows: npt.NDArray[np.intp]
    angle_rad: Floats
    rate_rad_s: Floats


class Material:
    """Records of one run, read once; each may be absent (None).

    `earlier` is the run before it, without what a trace of that one found.
    """

    def __init__(self, folder: RunFolder, truth: Truth | None = None, earlier: "Material | None" = None) -> None:
        self.folder = folder
        self.truth = truth
        self.earlier = earlier
        self.capture: Capture | None = _unless_empty(folder.capture)
        self.estimates: Estimates | None = _unless_empty(folder.estimates)
        self.innovation: Innovation | None = _unless_empty(folder.innovation)
        self.timing: Timing | None = _unless_empty(folder.timing)
        self.settle_s = folder.settle_s

    @cached_property
    def result(self) -> Result:
        """result.json, or what the records give when the run did not come to write it."""
        return self.folder.result or summarise(self.folder)

    @cached_property
    def reference(self) -> Reference | None:
        """The truth given to the score, or else the rate channel of the record, integrated."""
        if self.estimates is None:
            return None
        if self.truth is not None:
            found = [
                (first + rows, part["angle_rad"][ours], part["rate_rad_s"][ours])
                for first, piece, part in self.truth.beside(self.estimates)
                for rows, ours in [part.at(piece.tick)]
            ]
            if not any(rows.size for rows, _, _ in found):
                return None
            rows, angle, rate = (np.concatenate(column) for column in zip(*found, strict=True))
            return Reference("truth", rows, angle, rate)
        if self.capture is None or self.capture.rate_rad_s is None:
            return None
        rate, t_s = self.capture.rate_rad_s, self.capture.t_s
        angle = np.concatenate([[0.0], np.cumsum(np.diff(t_s) * (rate[1:] + rate[:-1]) / 2)])
        _, rows, ours = np.intersect1d(self.estimates.tick, self.capture.tick, assume_unique=True, return_indices=True)
        return Reference("rate reference", rows, angle[ours], rate[ours]) if rows.size else None

    @cached_property
    def stiffness_per_s2(self) -> float | None:
        """Stiffness per unit mass that sets the resonance: the loop's target, else the mean of the
        estimates."""
        if self.estimates is None:
            return None
        target = self.estimates.header.get("target_stiffness_per_s2")
        if target:
            return float(target)
        found = [float(self.estimates[name][-1]) for name in ("kxx_per_s2", "kyy_per_s2") if name in self.estimates]
        return float(np.mean(found)) if found and np.mean(found) > 0 else None

    @property
    def resonance_Hz(self) -> float | None:
        """√stiffness / 2π."""
        stiffness = self.stiffness_per_s2
        return None if stiffness is None else float(np.sqrt(stiffness)) / (2 * np.pi)

    def constant(self, name: str) -> tuple[float, str] | None:
        """Truth or declared value of a constant (per unit mass), and which of the two it is; None when
        neither."""
        if self.truth is not None and name in self.truth.constants:
            return self.truth.constants[name], "the truth"
        device = self.folder.bench.get("device", {})
        mass = device.get("mass_kg")
        for key, names in _DECLARED.items():
            values = device.get(key, [])
            if mass and name in names and names.index(name) < len(values):
                return float(values[names.index(name)]) / float(mass), "the declared value"
        return None

    def scored(self, t_s: Floats) -> npt.NDArray[np.bool_]:
        """Which instants lie in the scored window; all of them when the record ends before it begins."""
        inside: npt.NDArray[np.bool_] = t_s >= self.settle_s
        return inside if inside.any() else np.ones_like(inside)

    def scored_innovation(self, innovation: Innovation) -> Innovation:
        """The scored window of the innovation; all of it when the record ends before it begins."""
        scored = innovation.since(self.settle_s)
        return scored if len(scored) else innovation


_DECLARED = {
    "stiffness_N_per_m": ("kxx_per_s2", "kyy_per_s2", "kxy_per_s2"),
    "damping_N_s_per_m": ("dxx_per_s", "dyy_per_s", "dxy_per_s"),
}


def _unless_empty(record: _Record | None) -> _Record | None:
    return record if record is not None and len(record) else None
