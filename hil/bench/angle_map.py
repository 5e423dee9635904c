"""A file of what a device's rate is off by over the angle: `calibrations/SERIAL.toml`, of `hil characterise`."""

from datetime import date
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field

from estimator.characteristics.angle_map import AngleMap
from hil.bench.section import NotNegative, Section, as_tuple
from hil.records.atomic import write_text
from hil.toml.reading import parse_table, read_table, toml_value

Four = Annotated[tuple[float, float, float, float], BeforeValidator(as_tuple)]
_NONE = (0.0, 0.0, 0.0, 0.0)


class Harmonics(Section):
    """Coefficients of cos kθ and sin kθ, k = 1 to 4, with their standard uncertainties."""

    cos: Four = _NONE
    sin: Four = _NONE
    u: Four = _NONE


class Calibrated(Section):
    """The file."""

    serial_number: Annotated[str, Field(min_length=1)]
    date: date
    temperature_C: float | None = None
    least_rate_rad_s: float
    most_rate_rad_s: float
    seconds: NotNegative
    records: Annotated[tuple[str, ...], BeforeValidator(as_tuple)] = ()
    bias_rad_s: Harmonics = Harmonics()
    scale_factor: Harmonics = Harmonics()

    def map(self) -> AngleMap:
        """Its even harmonics: the pattern after half a turn is the same, so odd ones are none of the device."""
        even = np.array([0.0, 1.0, 0.0, 1.0])
        bias, scale = (np.array([part.cos, part.sin]) * even for part in (self.bias_rad_s, self.scale_factor))
        return AngleMap(bias, scale)


def read_angle_map(path: Path) -> Calibrated:
    """The file at `path`.  Raises InputError with file, key and what was expected."""
    return parse_table(read_table(path), Calibrated, str(path))


def write_angle_map(path: Path, known: Calibrated) -> None:
    """Write it, whole or not at all; one of another day is replaced."""
    lines = ["# What depends on the pattern's angle θ, by hil characterise; [device.calibration] angle_map applies it."]
    table = known.model_dump(exclude_none=True)
    parts = {name: table.pop(name) for name in ("bias_rad_s", "scale_factor")}
    lines += [
        f"{key} = {value.isoformat() if isinstance(value, date) else toml_value(value)}" for key, value in table.items()
    ]
    for name, part in parts.items():
        lines += ["", f"[{name}]", *(f"{key} = {toml_value(value)}" for key, value in part.items())]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, "\n".join(lines) + "\n")
