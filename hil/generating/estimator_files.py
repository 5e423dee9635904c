"""gyro_estimator.h and .c of one observer."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import estimator.core
from estimator.core.generate.header import generated
from estimator.effects.declaration import Effect, Source
from estimator.interface import NAME
from estimator.observer import Observer
from hil.errors import InputError
from hil.generating.source import Item, chosen, items, macros, reached, struct_of, with_numbers

INTERFACE = 2
"""GYRO_ESTIMATOR_VERSION: rises with a change that a caller would notice."""

_ENTRIES = ("controller", "block")
"""The core's headers that the interface calls; they name the others."""

_ROOTS = (
    "workspace_begin", "advance_queue", "advance_filter", "command", "Settings", "Memory", "Output", "Workspace",
    "Observer", "Sample", "entry_of", "RATE",
)  # fmt: skip
"""What the interface and the data name of it."""

_PUBLIC = {"Memory": "gyro_memory", "Output": "gyro_output", "Push": "gyro_push", "FlowWork": "gyro_flow_work",
           "Workspace": "gyro_workspace", "real": "gyro_real", "whole": "gyro_whole"}  # fmt: skip
_SHORT = (
    "Numbers have 32 bits; time, the angle and its sums have 64, and each\n * state and constant is kept with what "
    "its 32 bits do not hold: compile without -ffast-math."
)
_INCLUDE = re.compile(r'^#include "(\w+)\.h"$', re.MULTILINE)
_OF_ITS_OWN = re.compile(r"    if \(is_own\(effect\)\) \{.*?\n    \}\n", re.DOTALL)
"""How the core calls a law that is compiled apart; here all laws stand beside the others."""

_CORE = Path(estimator.core.__path__[0])


def require_writable(effects: Sequence[Effect], place: str) -> None:
    """InputError naming the first effect that a board's estimator cannot have."""
    for effect in effects:
        if any(signal.source is Source.TEMPERATURE for signal in effect.signals):
            where = "device.sense.interface" if effect.name == NAME else f"effects.{effect.name}"
            raise InputError(
                f"{place}: [{where}] depends on the temperature, which a board's estimator is not given; "
                "take it out of the bench file that is generated from"
            )


def model_text(observer: Observer, place: str) -> str:
    """The generated functions of the model and of the effects that are declared, and of no others."""
    declared = [effect for _, effect in observer.effects]
    require_writable(declared, place)
    try:
        return generated([observer.model], declared, range(len(declared)))
    except NotImplementedError as error:
        raise InputError(f"{place}: {error}") from None


def sizes_of(observer: Observer) -> dict[str, int]:
    """Lengths of the core's arrays for this observer; none is zero, which C does not allow."""
    record = observer.arrays.settings[0]
    delayed = any(record[name] >= 0 for name in ("sense_delay", "drive_delay"))
    return {
        "MAX_LATENCY": int(record["latency"]),
        "MAX_EFFECTS": max(len(observer.effects), 1),
        "MAX_SIGNALS": max(int(record["signal_count"]), 1),
        "MAX_SLIPS": max(int(record["slip_count"]), 1),
        "MAX_DEGREE": 1,
        "MAX_TERMS": 1,
        **({} if delayed else {"MAX_DELAY": 1}),
        "MAX_ENTRIES": len(observer.x),
    }


def core_items(observer: Observer, place: str, *, float32: bool) -> list[Item]:
    """What of the core this observer needs, in order."""
    sizes = sizes_of(observer)
    defined = {name: str(size) for name, size in sizes.items()} | {"CORE_INT32": ""}
    if float32:
        defined["CORE_FLOAT32"] = ""
    texts: dict[str, str] = {}
    for name in _ENTRIES:
        _gather(name, model_text(observer, place), texts)
    found = [item for text in texts.values() for item in items(chosen(text, defined)) if item.words]
    given = [Item(f"#define {name} {size}", frozenset([name]), frozenset()) for name, size in sizes.items()]
    own = [item for item in found if not (item.is_macro and item.names & sizes.keys())]
    return [*given, *own]


def _gather(name: str, model: str, texts: dict[str, str]) -> None:
    """Put a header into `texts` behind those that it includes."""
    if name in texts:
        return
    text = model if name == "model" else (_CORE / f"{name}.h").read_text("ascii")
    for other in _INCLUDE.findall(text):
        _gather(other, model, texts)
    texts[name] = _OF_ITS_OWN.sub("", text)


def files_of(observer: Observer, facts: Mapping[str, str], place: str, *, float32: bool) -> dict[str, str]:
    """Name and text of both files; facts: what the templates say of the bench and the board.

    Raises InputError naming an effect that cannot be written.
    """
    found = core_items(observer, place, float32=float32)
    kept = reached(found, _ROOTS)
    lengths = macros(kept)
    structs, core, typedefs = [], [], []
    for item in kept:
        struct = struct_of(item)
        if struct and struct[1] in _PUBLIC:
            structs.append(_public(item.text, lengths))
            typedefs.append(f"typedef {_PUBLIC[struct[1]]} {struct[1]};")
        elif not item.names & {"real", "whole"}:
            core.append(item.text)
    record, sizes = observer.arrays.settings[0], sizes_of(observer)
    both = bool(record["two_covariances"])
    coefficients = observer.names[len(observer.model.names) :]
    n, total = len(observer.estimated), len(observer.x)
    covariance = n * (-(-n // 4) * 4)  # rows as long as the core takes
    values = {
        **facts,
        "VERSION": str(INTERFACE),
        "REAL": _SHORT if float32 else "Numbers have 64 bits.",
        "TYPE": "float" if float32 else "double",
        "STRUCTS": "\n\n".join(structs) + "\n",
        "TYPEDEFS": "\n".join(typedefs),
        "CORE": _spaced(core),
        "DATA": data(observer, Numbers(float32=float32), sizes, 0),
        "N": str(n),
        "TOTAL": str(total),
        "COVARIANCE": str(covariance),
        "SECOND": f"    gyro_real c[{covariance}];\n" if both else "",
        "INIT_SECOND": "        estimator->c[i * filled_up(ESTIMATED) + i] = initial_variance[i];\n" if both else "",
        "C": "estimator->c" if both else "estimator->p",
        "ACTUAL": "c" if both else "p",
        "DITHER": str(int(observer.arrays.memory["dither"][0])),
        "ANGLES": str(observer.arrays.table.shape[0]),
        "PHASES": str(observer.arrays.table.shape[1]),
        "COEFFICIENT_NAMES": "".join(f", GYRO_{_identifier(name)}" for name in coefficients),
        "UNITS": _units(observer),
        "REFERENCE": f"{observer.settings.reference:g}",
    }
    return {name: filled(name, values) for name in ("gyro_estimator.h", "gyro_estimator.c")}


def filled(name: str, values: Mapping[str, str]) -> str:
    """A template with its places filled in. Raises KeyError for a place that has no value."""
    text = files("hil.generating").joinpath("text", name).read_text("utf-8")
    return re.sub(r"@([A-Z][A-Z0-9_]*)@", lambda found: values[found[1]], text)


def _public(text: str, lengths: Mapping[str, str]) -> str:
    """A structure as the header has it: names of its own, lengths as numbers."""
    renamed = re.sub(r"\b(" + "|".join(_PUBLIC) + r")\b", lambda found: _PUBLIC[found[1]], with_numbers(text, lengths))
    return renamed.strip()


def _spaced(texts: Sequence[str]) -> str:
    """Macros beside one another, everything else an empty line apart."""
    out = ""
    for text in texts:
        out += ("\n" if text.startswith("#define") and out.rpartition("\n")[2].startswith("#define") else "\n\n") + text
    return out.strip()


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", name).upper()


def _units(observer: Observer) -> str:
    units = observer.coefficient_units
    told = "m, m/s; V; rad/s; 1/s2; 1/s"
    return told + "".join(f"; {name} {units[name] or '1'}" for name in observer.names if name in units).replace(
        "·", " "
    )


def decimal(value: float) -> str:
    """A number as C reads it, with its point."""
    return repr(float(value)) if math.isfinite(value) else "0.0"


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
