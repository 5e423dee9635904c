"""An observer's settings and initial values as C initialisers."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Observer
from hil.errors import InputError

_LINE = 116


class Numbers:
    """How numbers are written: real ones by the core's macro R, in the length that the board computes with."""

    def __init__(self, *, float32: bool) -> None:
        self.float32 = float32

    def real(self, value: float) -> str:
        """Raises InputError for a number that the board's length cannot hold."""
        value = float(value)
        kept = float(np.float32(value)) if self.float32 else value
        if not np.isfinite(kept) or (value != 0.0 and kept == 0.0):
            raise InputError(f"{value:g} does not fit into a float of 32 bits; generate it without --float32")
        return f"R({np.float32(value)!s})" if self.float32 and "." in str(np.float32(value)) else f"R({value!r})"

    def of(self, array: NDArray[Any]) -> str:
        """A number, or an array in braces; whole numbers as they are."""
        if array.ndim:
            return "{" + ", ".join(self.of(np.asarray(part)) for part in array) + "}"
        return str(int(array)) if array.dtype.kind in "iu" else self.real(float(array))

    def array(self, name: str, values: Iterable[Any], kind: str = "real", comment: str = "") -> str:
        """`static const` of one dimension; one number where there would be none, since C has no empty array."""
        listed = [self.of(np.asarray(value)) for value in values] or ["0" if kind == "whole" else "R(0.0)"]
        lines, line = [], "   "
        for entry in listed:
            if len(line) + len(entry) + 2 > _LINE:
                lines.append(line)
                line = "   "
            line += f" {entry},"
        told = f"/* {comment} */\n" if comment else ""
        return f"{told}static const {kind} {name}[{len(listed)}] = {{\n" + "\n".join([*lines, line]) + "\n};"


def settings_of(observer: Observer, numbers: Numbers, sizes: Mapping[str, int], model: int) -> str:
    """The settings by their names, their arrays as long as this observer needs, the effects numbered as they come."""
    record = observer.arrays.settings[0]
    own: dict[str, NDArray[Any]] = {name: np.asarray(record[name]) for name in record.dtype.names}
    own["model"], own["control"] = np.asarray(model), np.asarray(1)
    own["effects"] = own["effects"].copy()
    own["effects"][: len(observer.effects), 0] = np.arange(len(observer.effects))
    for name, most in (("effects", "MAX_EFFECTS"), ("signals", "MAX_SIGNALS"), ("signal_parameters", "MAX_SIGNALS"),
                       ("slips", "MAX_SLIPS")):  # fmt: skip
        own[name] = own[name][: sizes[most]]
    lines = [f"    .{name} = {numbers.of(value)}," for name, value in own.items()]
    return "static const Settings settings = {\n" + "\n".join(lines) + "\n};"


def data(observer: Observer, numbers: Numbers, sizes: Mapping[str, int], model: int) -> str:
    """All that is fixed."""
    arrays = observer.arrays
    units = observer.factors
    return "\n\n".join(
        [
            settings_of(observer, numbers, sizes, model),
            numbers.array("active", arrays.active, "whole", "constants that are estimated"),
            numbers.array("intensity", arrays.intensity, comment="variance of their random walks, per unit of time"),
            numbers.array("prior", arrays.prior, comment="variance of what is given back of the initial values"),
            numbers.array("spread", arrays.spread, comment="initial variances"),
            numbers.array("initial_constants", arrays.initial),
            numbers.array("gains", np.ravel(arrays.table), comment="stationary, by pattern angle and phase"),
            numbers.array("initial_state", arrays.x, comment=", ".join(observer.names)),
            numbers.array("initial_variance", observer.initial_deviations**2),
            numbers.array("unit", units, comment="of each entry of the state, SI"),
            numbers.array("unit_V", observer.volts, comment="of a unit of length"),
            f"static const real unit_mps2 = {numbers.real(observer.scaling.drive)};",
        ]
    )
