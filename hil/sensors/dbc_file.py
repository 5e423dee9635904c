"""A DBC, of a sensor's maker or of ours: its messages, and which of their signals are rates, by their units."""

import logging
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hil.errors import InputError
from hil.records.layout import Column
from hil.sensors.declared import SI
from hil.wire.regular_file import require_regular

_SPELLINGS = {
    "°/s": "deg/s", "deg/sec": "deg/s", "degree/s": "deg/s", "degrees/s": "deg/s", "dps": "deg/s",
    "rad/sec": "rad/s", "rads/s": "rad/s", "rad": "rad", "°": "deg", "degree": "deg", "degrees": "deg",
    "m/s^2": "m/s2", "m/s²": "m/s2", "m/s/s": "m/s2", "meters/s^2": "m/s2",
    "°c": "degc", "deg c": "degc", "celsius": "degc", "c": "degc",
}  # fmt: skip
_SI = {unit.casefold(): si for unit, si in SI.items() if unit != "1"}
_AXES = {"x": "x", "roll": "x", "y": "y", "pitch": "y", "z": "z", "yaw": "z"}


Key = tuple[int, bool]
"""Of a message: its identifier, and whether that has 29 bits. Names need not be unique."""


class Signal(NamedTuple):
    """A signal of a message: what it is called there, and the column it fills; values are physical, as the DBC says."""

    name: str
    column: Column

    @property
    def is_rate(self) -> bool:
        """Whether it is an angular rate."""
        return self.column.unit == "rad/s"


def key_of(message: Any) -> Key:
    """By which a message is told from the others of its database."""
    return message.frame_id, message.is_extended_frame


def load_dbc(path: Path) -> Any:
    """The database at `path`. Raises InputError, one line, for what is none, and where cantools is not installed."""
    try:
        import cantools.database
    except ImportError:
        raise InputError(f"{path}: a DBC needs the package cantools; install gyrohil[can]") from None
    logging.getLogger("cantools").setLevel(logging.ERROR)  # it warns of messages of one name
    try:
        require_regular(path)
        return cantools.database.load_file(path, database_format="dbc", strict=False)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; give the path of a DBC") from None
    except Exception as error:  # of its parser there are many kinds
        where = re.sub(r"\s+", " ", str(error)).strip().rstrip(".")
        raise InputError(f"{path}: no DBC that can be read: {where[:150]}; export it anew") from error


def signals_of(messages: Sequence[Any]) -> Mapping[Key, Sequence[Signal]]:
    """Of each message by its key the signals with a unit that is known."""
    told = [(message, signal, _unit(signal)) for message in messages for signal in message.signals]
    rates = [signal.name for _, signal, unit in told if unit is not None and unit[0] == "rad/s"]
    axes = [_axis(name) for name in rates]
    plain = None not in axes and len(set(axes)) == len(axes)
    taken: set[str] = set()
    found: dict[Key, list[Signal]] = {key_of(message): [] for message in messages}
    for message, signal, unit in told:
        if unit is None:
            continue
        name = re.sub(r"\W", "_", signal.name).lower()
        if unit[0] == "rad/s":
            name = f"rate_{_axis(signal.name) if plain else name.removeprefix('rate_')}"
        longer = (name, f"{name}_{message.name.lower()}", f"{name}_{message.name.lower()}_{message.frame_id:x}")
        name = next((one for one in longer if one not in taken), longer[-1])
        taken.add(name)
        found[key_of(message)].append(Signal(signal.name, Column(f"{name}_code", "f8", *unit)))
    return found


def _unit(signal: Any) -> tuple[str, float] | None:
    """SI unit and factor of a signal's unit, where it is one that is known."""
    unit = (signal.unit or "").strip().casefold()
    return _SI.get(_SPELLINGS.get(unit, unit))


def _axis(name: str) -> str | None:
    """The axis that a name speaks of, where it is one."""
    words = re.findall(r"[a-z]+", re.sub(r"([A-Z]+)", r" \1", name).lower())
    found = {_AXES[word] for word in words if word in _AXES}
    return found.pop() if len(found) == 1 else None
