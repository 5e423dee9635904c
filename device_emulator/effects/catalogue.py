"""All hidden effects by name, and how a scenario's tables are read."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from device_emulator.effects.declaration import MAX_COEFFICIENTS
from device_emulator.effects.kinds import DECLARATIONS, NUMBERS
from device_emulator.section import did_you_mean

EFFECT = np.dtype([("kind", "i8"), ("at", "i8"), ("c", "f8", (MAX_COEFFICIENTS,))], align=True)
"""`at` is the first of an effect's own states in the vector [x, ẋ, y, ẏ, …]."""


class HiddenEffect(NamedTuple):
    """One `[[effect]]` of a scenario with all its coefficients."""

    name: str
    coefficients: dict[str, float]


def parse(entry: Any) -> HiddenEffect:
    """The effect of one `[[effect]]` table. Raises ValueError: one line that says what was expected."""
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise ValueError("expected a table with a name and coefficients")
    name = entry["name"]
    if name not in DECLARATIONS:
        raise ValueError(f"unknown effect {name!r}; {did_you_mean(name, DECLARATIONS)}")
    declared = {c.symbol: c for c in DECLARATIONS[name].coefficients}
    given = {symbol: value for symbol, value in entry.items() if symbol != "name"}
    for symbol, value in given.items():
        if symbol not in declared:
            raise ValueError(f"{name} has no coefficient {symbol!r}; {did_you_mean(symbol, declared)}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"expected a finite number for {symbol}, got {value!r}")
        if declared[symbol].positive and value <= 0:
            raise ValueError(f"expected a number above 0 for {symbol}, got {value!r}")
        if declared[symbol].switch and value not in (0, 1):
            raise ValueError(f"expected 0 or 1 for {symbol}, got {value!r}")
        if value <= declared[symbol].above:
            raise ValueError(f"expected a number above {declared[symbol].above:g} for {symbol}, got {value!r}")
    missing = [symbol for symbol, c in declared.items() if c.default is None and symbol not in given]
    if missing or not given:
        raise ValueError(f"{name} needs {', '.join(missing or declared)}")
    return HiddenEffect(name, {s: float(given.get(s, c.default or 0)) for s, c in declared.items()})


def table(effects: Iterable[HiddenEffect]) -> NDArray[Any]:
    """The effects as the kernels read them (dtype `EFFECT`)."""
    effects = list(effects)
    rows = np.zeros(len(effects), EFFECT)
    at = 4
    for row, effect in zip(rows, effects, strict=True):
        row["kind"] = NUMBERS[effect.name]
        row["at"] = at
        row["c"][: len(effect.coefficients)] = list(effect.coefficients.values())
        at += DECLARATIONS[effect.name].states
    return rows


def inner_states(effects: Iterable[HiddenEffect]) -> int:
    """How many states the effects have of their own."""
    return sum(DECLARATIONS[effect.name].states for effect in effects)


def delay_s(effects: Iterable[HiddenEffect], name: str) -> tuple[float, float]:
    """Total delay in s of the x and the y channel. Delays act on times, not on values: no kernel here."""
    delays = [tuple(effect.coefficients.values()) for effect in effects if effect.name == name]
    return sum(x for x, _ in delays), sum(y for _, y in delays)


def slew_mps3(effects: Iterable[HiddenEffect]) -> tuple[float, float]:
    """Steepest change of the drive per axis, infinite without a limit."""
    slews = [effect.coefficients for effect in effects if effect.name == "drive_slew"]
    x, y = (min([math.inf, *(c[f"slew_{axis}"] for c in slews)]) for axis in "xy")
    return x, y


def resonance_Hz(effects: Iterable[HiddenEffect]) -> float:
    """The highest resonance among the effects' own, 0 without any."""
    own = [effect.coefficients["frequency"] for effect in effects if effect.name == "parasitic_mode"]
    own += [effect.coefficients["wm"] / (2.0 * math.pi) for effect in effects if effect.name == "free_mode"]
    own += [
        math.sqrt(effect.coefficients["s"]) / (2.0 * math.pi)
        for effect in effects
        if effect.name == "stick_slip_support"
    ]
    return max(own, default=0.0)
