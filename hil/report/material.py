"""What a report is made of: the run's records, and a reference to hold them against when there is one."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hil.records.capture import Capture
from hil.records.estimates import Estimates, Innovation
from hil.records.rate_reference import Compared, beside_rate
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.records.summary import summarise
from hil.records.timing import Timing
from hil.records.truth import Truth
from hil.report.pixel_series import COLUMNS, PixelSeries, first_since, pixel_series

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Reference:
    """What the estimates are held against: each call of `parts` goes through all of it once."""

    name: str
    parts: Callable[[], Iterator[Compared]]


class Material:
    """Records of one run, read once; each may be absent (None).

    `earlier` is the run before it, without what a trace of that one found.
    """

    def __init__(self, folder: RunFolder, truth: Truth | None = None, earlier: "Material | None" = None) -> None:
        self.folder = folder
        self.truth = truth
        self.earlier = earlier
        self.capture: Capture | None = folder.capture or None
        self.estimates: Estimates | None = folder.estimates or None
        self.innovation: Innovation | None = folder.innovation or None
        self.timing: Timing | None = folder.timing or None
        self.settle_s = folder.scored_from_s

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
            reference = Reference("truth", self._beside_truth)
        elif self.capture is not None and "rate_rad_s" in self.capture.columns:
            reference = Reference("rate reference", self._beside_rate)
        else:
            return None
        return reference if next(reference.parts(), None) is not None else None

    def _beside_truth(self) -> Iterator[Compared]:
        assert self.estimates is not None
        assert self.truth is not None
        for _, piece, part in self.truth.beside(self.estimates):
            rows, ours = part.at(piece.tick)
            if rows.size:
                yield Compared(piece, rows, part["angle_rad"][ours], part["rate_rad_s"][ours])

    def _beside_rate(self) -> Iterator[Compared]:
        assert self.estimates is not None
        assert self.capture is not None
        return beside_rate(self.capture, self.estimates)

    @cached_property
    def stiffness_per_s2(self) -> float | None:
        """Stiffness per unit mass that sets the resonance: the loop's target, else the mean of the
        estimates."""
        if self.estimates is None:
            return None
        target = self.estimates.header.get("target_stiffness_per_s2")
        if target:
            return float(target)
        last = self.estimates.part(len(self.estimates) - 1, len(self.estimates))
        found = [float(last[name][0]) for name in ("kxx_per_s2", "kyy_per_s2") if name in last]
        mean = float(np.mean(found)) if found else 0.0
        return mean if 0.0 < mean < math.inf else None

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

    def drawn(
        self, series: Callable[[Estimates], list[Floats]], *, since_s: float | None = None, columns: int = COLUMNS
    ) -> PixelSeries:
        """Series of the estimates, (n,) each, that `series` makes of a part of them; scored from `since_s` on, or from
        where scoring starts."""
        assert self.estimates is not None
        parts = ((part.t_s, np.stack(series(part), 1)) for part in self.estimates.pieces())
        since_s = self.settle_s if since_s is None else since_s
        return pixel_series(parts, self.estimates.ends_s, len(self.estimates), since_s, columns)

    def compared(
        self, reference: Reference | None, series: Callable[[Compared], list[Floats]], *, since_s: float | None = None
    ) -> PixelSeries:
        """The same of series that `series` makes of estimates beside their reference; without one, see `alone`."""
        assert self.estimates is not None
        every = self.alone() if reference is None else reference.parts()
        parts = ((part.t_s, np.stack(series(part), 1)) for part in every)
        since_s = self.settle_s if since_s is None else since_s
        return pixel_series(parts, self.estimates.ends_s, len(self.estimates), since_s)

    def at_first(self, reference: Reference | None, series: Callable[[Compared], list[Floats]]) -> Floats:
        """Such values (k,) where scoring starts; without a reference those of the estimates alone."""
        parts = self.alone() if reference is None else reference.parts()
        return first_since(((part.t_s, np.stack(series(part), 1)) for part in parts), self.settle_s)

    def from_zero(
        self, reference: Reference | None, series: Callable[[Compared], list[Floats]]
    ) -> Callable[[Compared], list[Floats]]:
        """The same series less what they are where scoring starts. Before that the angle has another zero, and a pixel
        that has rows of both would leave the frame: NaN there."""
        assert self.estimates is not None
        zeros = self.at_first(reference, series)
        begin = -np.inf if self.settle_s > self.estimates.ends_s[1] else self.settle_s
        return lambda part: [
            np.where(part.t_s < begin, np.nan, value - zero) for value, zero in zip(series(part), zeros, strict=True)
        ]

    def alone(self) -> Iterator[Compared]:
        """The estimates beside their own angle, where there is no reference."""
        assert self.estimates is not None
        for part in self.estimates.pieces():
            yield Compared(part, np.arange(len(part)), part["angle_rad"], part["angle_rad"])

    def scored_innovation(self, innovation: Innovation) -> Innovation:
        """The scored window of the innovation; all of it when the record ends before it begins."""
        scored = innovation.since(self.settle_s)
        return scored if len(scored) else innovation


_DECLARED = {
    "stiffness_N_per_m": ("kxx_per_s2", "kyy_per_s2", "kxy_per_s2"),
    "damping_N_s_per_m": ("dxx_per_s", "dyy_per_s", "dxy_per_s"),
}
