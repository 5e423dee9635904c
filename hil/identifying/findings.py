"""What an identification has found, and what of a board's own word it refutes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.identify.derived import Constant, constants_of
from estimator.identify.fit import Fitted
from hil.identifying.advice import Advice
from hil.wire.messages import Identity


@dataclass(frozen=True)
class Findings:
    """Of one board: constants by name (SI per unit mass), noise (2,) [V] and force noise [m/s²/√Hz] of the record,
    latency in ticks as measured, what of IDENTITY or of the declaration is refuted, what could not be told; settings
    that are proposed, and what they will reach, None for a board that is not as it says.
    """

    identity: Identity
    fitted: Fitted
    constants: Mapping[str, Constant]
    noise_V: NDArray[np.float64]
    force_mps2_per_rtHz: float
    latency_ticks: int
    rows: int
    limit_V: NDArray[np.float64]
    largest_mps2: float
    faults: tuple[str, ...] = ()
    untold: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    advice: Advice | None = None

    def value(self, name: str) -> float:
        """A constant."""
        return self.constants[name].value

    def u(self, name: str) -> float:
        """Its standard uncertainty."""
        return self.constants[name].u

    @property
    def omega(self) -> float:
        """Of the mean stiffness, rad/s."""
        return float(np.sqrt(0.5 * (self.value("kxx") + self.value("kyy"))))

    def as_json(self) -> dict[str, Any]:
        """The same in JSON values."""
        return {
            "identity": self.identity._asdict(),
            "constants": {name: _told(one) for name, one in self.constants.items()},
            "noise_V": self.noise_V.tolist(),
            "force_noise_mps2_per_rtHz": self.force_mps2_per_rtHz,
            "latency_ticks": {"measured": self.latency_ticks, "identity": self.identity.latency_ticks},
            "samples": self.rows,
            "faults": list(self.faults),
            "untold": list(self.untold),
            "remarks": list(self.remarks),
            "proposed": {section: dict(table) for section, table in self.settings.items()},
            "predicted": None if self.advice is None else self.advice.as_json(),
        }


def _told(one: Constant) -> dict[str, Any]:
    """With its expanded uncertainty; what a record does not tell at all is null."""
    whole = {**one._asdict(), "expanded_u": 2.0 * one.u}
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in whole.items()}


def findings_of(found: Fitted, identity: Identity, limit_V: NDArray[np.float64], largest: float) -> Findings:
    """Of a fit, before anything is made of it."""
    rate = identity.tick_rate_Hz
    constants = constants_of(found, rate)
    # A drive that acts a sample later than its row says has that much more latency than IDENTITY tells.
    latency = identity.latency_ticks + round(constants["delay"].value)
    density = float(np.sqrt(2.0 * found.force / rate))
    return Findings(identity, found, constants, found.noise, density, latency, found.samples, limit_V, largest)


CALLED = {
    "kxx": "stiffness along x",
    "kyy": "stiffness along y",
    "kxy": "stiffness between x and y",
    "dxx": "damping along x",
    "dyy": "damping along y",
    "dxy": "damping between x and y",
    "rate": "rotation of the board",
    "gain_x": "gain x, sense × drive",
    "gain_y": "gain y, sense × drive",
    "share_xy": "share of drive y that pushes x",
    "share_yx": "share of drive x that pushes y",
    "delay": "delay beside latency",
    "offset_x": "sense offset x",
    "offset_y": "sense offset y",
    "resonance_1": "resonance 1, the higher",
    "resonance_2": "resonance 2",
    "split": "split of the resonances",
    "azimuth": "axis of resonance 1, from x",
    "decay_time_1": "shorter decay time",
    "decay_time_2": "longer decay time",
    "q_1": "Q of resonance 1",
    "q_2": "Q of resonance 2",
    "damping_azimuth": "axis of the shorter decay, from x",
    "sense_gain_ratio": "gain y over gain x",
}
