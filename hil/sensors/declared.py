"""Sold gyros as they are declared in `protocols.toml`: fields, frames, checksums, status bits; facts, no code.

A declaration says how a frame begins, how long it is and where its fields stand, in one of four ways: `frames` (by the
bytes it begins with), `groups` (by bits of its head), `tags` (each value with its identifier), `sentences` (text).
"""

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from hil.records.layout import Column

G_MPS2 = 9.80665
SI = {
    "deg/s": ("rad/s", math.radians(1.0)),
    "rad/s": ("rad/s", 1.0),
    "deg": ("rad", math.radians(1.0)),
    "rad": ("rad", 1.0),
    "g": ("m/s²", G_MPS2),
    "m/s2": ("m/s²", 1.0),
    "m/s": ("m/s", 1.0),
    "degC": ("°C", 1.0),
    "gauss": ("T", 1e-4),
    "kPa": ("Pa", 1e3),
    "Pa": ("Pa", 1.0),
    "us": ("µs", 1.0),
    "s": ("s", 1.0),
    "V": ("V", 1.0),
    "1": ("", 1.0),
}


class Field(NamedTuple):
    """One value of a frame: what it is called, its type, what one count is in `unit`; of a status where it begins."""

    name: str
    type: str
    factor: float = 1.0
    unit: str = "1"

    @property
    def column(self) -> Column | None:
        """The column it fills; None for what has none of its own."""
        if self.name in ("-", "counter", "clock", "status", "latency_us", "time_ns"):
            return None
        unit, scale = SI[self.unit]
        kind = "f4" if self.type in "fF" else "f8" if self.type in "dIqQw" else "i4"
        return Column(f"{self.name.partition('@')[0]}_code", kind, unit, scale * self.factor)


@dataclass(frozen=True)
class Protocol:
    """One table of the file, as it stands there; `how` are the keys of its way of framing."""

    name: str
    title: str
    source: str
    bauds: tuple[int, ...]
    rates_Hz: tuple[float, ...]
    note: str = ""
    counter_size: int = 0
    counter_Hz: float = 0.0
    clock_Hz: float = 0.0
    order: str = "<"
    check: str = "none"
    check_from: int = 0
    tail: bytes = b""
    ends: bytes = b""
    how: Mapping[str, Any] = field(default_factory=dict)
    status: Mapping[str, Any] = field(default_factory=dict)

    def complaints(self, status: int) -> list[str]:
        """What a status says, in words; nothing for a healthy sample."""
        told = []
        for part, words in enumerate(self.status.get("repeats", ("",))):
            here = status >> (8 * part)
            for bit, complaint in self.status.get("bits", {}).items():
                if here >> int(bit) & 1:
                    qualified = int(bit) in self.status.get("qualified", ())
                    axes = [axis for k, axis in enumerate("xyz") if here >> k & 1] if qualified else []
                    told.append(words + (f"{complaint} ({', '.join(axes)})" if axes else complaint))
        return told


@cache
def protocols() -> Mapping[str, Protocol]:
    """Every declared protocol of a serial line, by its name."""
    declared = tomllib.loads(files("hil.sensors").joinpath("protocols.toml").read_text(encoding="utf-8"))
    return {name: _protocol(name, dict(table)) for name, table in declared.items()}


@cache
def can_protocols() -> Mapping[str, Mapping[str, Any]]:
    """Every declared protocol on CAN, by its name."""
    return tomllib.loads(files("hil.sensors").joinpath("can_protocols.toml").read_text(encoding="utf-8"))


def _protocol(name: str, table: dict[str, Any]) -> Protocol:
    how: dict[str, Any] = {
        key: table.pop(key) for key in ("blocks", "frames", "groups", "tags", "sentences") if key in table
    }
    for key in ("tail", "ends"):
        table[key] = bytes.fromhex(table.get(key, ""))
    for key in ("bauds", "rates_Hz"):
        table[key] = tuple(table[key])
    return Protocol(name, how=how, **table)


def fields_of(texts: Sequence[str]) -> Iterator[Field]:
    """The fields that such texts declare."""
    for text in texts:
        name, kind, *rest = text.split()
        factor = math.prod(_number(part) for part in rest[0].split("*")) if rest else 1.0
        unit = rest[1] if len(rest) > 1 else "1"
        stem = name.removesuffix("_xyz")
        for each in (name,) if stem == name else [f"{stem}_{axis}" for axis in "xyz"]:
            yield Field(each, kind, factor, unit)


def _number(text: str) -> float:
    base, power, exponent = text.partition("^")
    return float(base) ** int(exponent) if power else float(base)
