"""Samples from CAN frames by a DBC: one decoder for every gyro on CAN.

A sample is what the messages with rates say in one cycle: until one of them comes again, or until the counter that they
share moves on. A cycle that lacks one of them is dropped. What comes more seldom is held. Samples are numbered by the
stamps of their frames, which the interface or the kernel gives: a lost frame leaves a gap whatever the counter has.
"""

import logging
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.errors import InputError
from hil.records.layout import Column
from hil.sensors.adapter import Sample
from hil.sensors.declared import SI, can_protocols
from hil.wire.regular_file import require_regular

if TYPE_CHECKING:
    import can


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


STAMPS_HZ = 1e6
_SIZE = 1 << 32
_WARM = 3  # cycles from which it is known which messages belong to one
_SELDOM = 0.75  # of the cycles: a message that comes less often is held
_FAST = 8  # bytes; a longer message comes in parts (NMEA 2000's fast packets)


class Decoded(NamedTuple):
    """One message: its key, its signals as sent, in physical units by column, and whether all its rates are told."""

    message: Key
    raw: Mapping[str, int]
    values: dict[str, float]
    whole_rates: bool


class CanDecoder:
    """Decoder of the frames of one sensor, the first that speaks by the DBC; see `hil.sensors.adapter.Adapter`.

    Attributes:
        frames: those that the DBC has.
        incomplete: cycles that lacked a message.
        others: frames of other senders of the same messages.
        unknown: identifiers that the DBC does not have, with how often they came.
    """

    link = "can"
    baud = 0
    counter_size, counter_Hz = _SIZE, STAMPS_HZ
    crc_errors = skipped = 0

    def __init__(
        self, name: str, title: str, database: Any, *, rates_Hz: tuple[float, ...] = (), counter: str | None = None,
        match: Mapping[str, int] | None = None,
    ) -> None:  # fmt: skip
        self.name, self.title, self.rates_Hz = name, title, rates_Hz
        self._counter, self._match = counter, dict(match or {})
        self._signals: Mapping[Key, Sequence[Signal]] = signals_of(database.messages)
        self._exact = {(one.frame_id, one.is_extended_frame): one for one in database.messages}
        self._by_pgn = {_pgn(one.frame_id): one for one in database.messages if one.protocol == "j1939"}
        self._rated = {key for key, signals in self._signals.items() if any(one.is_rate for one in signals)}
        self._columns = [one.column for signals in self._signals.values() for one in signals]
        self._statuses = [one.name for message in database.messages for one in message.signals
                          if one.name.startswith("status_")]  # fmt: skip
        self._held: dict[str, float] = {}
        self._cycle: dict[Key, float] = {}  # message: stamp
        self._count: int | None = None
        self._status = 0
        self._heard: Counter[Key] = Counter()
        self._cycles = self.frames = self.incomplete = self.others = 0
        self.unknown: Counter[int] = Counter()
        self._sources: dict[Key, int] = {}
        self._parts: dict[int, tuple[int, bytes]] = {}

    @property
    def channels(self) -> tuple[Column, ...]:
        """The columns of the signals of messages that were heard; of all before that."""
        heard = {one.column for key in self._heard for one in self._signals[key]}
        return tuple(column for column in self._columns if column in heard or not heard)

    @property
    def called(self) -> dict[str, str]:
        """What the DBC calls the signals, with the columns' names without their `_code`."""
        return {one.name: one.column.name.removesuffix("_code") for all_ in self._signals.values() for one in all_}

    def feed(self, data: "Sequence[can.Message]") -> list[Sample]:
        """The samples that these frames complete. Never raises on what it reads."""
        return [sample for frame in data if (sample := self._take(frame)) is not None]

    def complaints(self, status: int) -> list[str]:
        """What a status says: which of the sensor's own status signals are not 0."""
        set_ = (name for bit, name in enumerate(self._statuses) if status >> bit & 1)
        return [f"{name.removeprefix('status_')}: not 0" for name in set_]

    def _take(self, frame: "can.Message") -> Sample | None:
        decoded = self.decoded(frame)
        if decoded is None:
            return None
        if self._sources.setdefault(decoded.message, frame.arbitration_id) != frame.arbitration_id:
            self.others += 1
            return None
        self.frames += 1
        return self._put(decoded, frame.timestamp)

    def decoded(self, frame: "can.Message") -> "Decoded | None":
        """What a frame says by the DBC; None of one that is not in it, is a part of a message, or is damaged."""
        message = None if frame.is_error_frame or frame.is_remote_frame else self._message(frame)
        if message is None:
            return None
        payload = bytes(frame.data)
        if message.length > _FAST >= len(payload) and message.protocol == "j1939":
            whole = self._joined(frame.arbitration_id, payload, message.length)
            if whole is None:
                return None
            payload = whole
        try:
            raw = message.decode(payload, decode_choices=False, scaling=False, allow_truncated=False)
        except Exception:  # noqa: BLE001 - a frame that is shorter than the DBC says, or has another multiplexer
            self.crc_errors += 1
            return None
        if any(raw.get(name) != wanted for name, wanted in self._match.items()):
            return None
        said = {one.name: one for one in message.signals}
        signals = [one for one in self._signals[key_of(message)] if one.name in raw]
        values = {
            one.column.name: float(raw[one.name]) * float(said[one.name].scale) + float(said[one.name].offset)
            for one in signals
            if _is_told(said[one.name], raw[one.name], message.protocol)
        }
        whole_rates = all(one.column.name in values for one in signals if one.is_rate)
        return Decoded(key_of(message), raw, values, whole_rates)

    def _message(self, frame: "can.Message") -> Any:
        found = self._exact.get((frame.arbitration_id, frame.is_extended_id))
        if found is None and frame.is_extended_id:
            found = self._by_pgn.get(_pgn(frame.arbitration_id))
        if found is None:
            self.unknown[frame.arbitration_id] += 1
        return found

    def _joined(self, identifier: int, part: bytes, length: int) -> bytes | None:
        """A fast packet, whole: three bits of sequence and five of place, then in the first its length."""
        sequence, place = part[0] >> 5, part[0] & 31
        if place == 0:
            self.crc_errors += identifier in self._parts  # the one before has no end
            self._parts.pop(identifier, None)
            if part[1] >= length:
                self._parts[identifier] = (sequence << 5 | 1, part[2:])
            return None
        expected, so_far = self._parts.pop(identifier, (-1, b""))
        if expected != part[0]:
            self.crc_errors += expected >= 0
            return None
        so_far += part[1:]
        if len(so_far) >= length:
            return so_far[:length]
        self._parts[identifier] = (expected + 1, so_far)
        return None

    def _put(self, decoded: "Decoded", stamp: float) -> Sample | None:
        key, raw = decoded.message, decoded.raw
        count = raw.get(self._counter) if self._counter is not None else None
        done = None
        moved = self._counter is not None and self._cycle and count != self._count
        if key in self._rated and (key in self._cycle or moved):
            done = self._closed()
        self._count = count
        if key in self._rated and not decoded.whole_rates:
            return done
        self._held |= decoded.values
        self._heard[key] += 1
        for bit, status in enumerate(self._statuses):
            if status in raw:
                self._status = self._status & ~(1 << bit) | bool(raw[status]) << bit
        if key in self._rated:
            self._cycle[key] = stamp
        return done

    def _closed(self) -> Sample | None:
        cycle, self._cycle = self._cycle, {}
        self._cycles += 1
        if self._cycles <= _WARM:
            return None
        most = max(self._heard[key] for key in self._rated)
        if any(key not in cycle and self._heard[key] >= _SELDOM * most for key in self._rated):
            self.incomplete += 1
            return None
        stamp = round(min(cycle.values()) * STAMPS_HZ) % _SIZE
        codes = tuple(self._held.get(column.name, 0.0) for column in self.channels)
        return Sample(stamp, codes, self._status, -1)


def _is_told(signal: Any, raw: int, protocol: str | None) -> bool:
    """Whether a value is one: J1939 and NMEA 2000 keep the highest for "error" and "not available"."""
    if protocol != "j1939":
        return True
    if signal.is_signed:
        return bool(raw < (1 << signal.length - 1) - 3)
    return bool(signal.length < 8 or raw >> signal.length - 8 <= 0xFA)


def _pgn(identifier: int) -> int:
    pgn = identifier >> 8 & 0x3FFFF
    return pgn if pgn >> 8 & 0xFF >= 240 else pgn & 0x3FF00


def declared_decoder(name: str) -> CanDecoder:
    """The decoder of a declared protocol. Raises InputError where cantools is not installed."""
    told = can_protocols()[name]
    with as_file(files("hil.sensors").joinpath("dbc", told["dbc"])) as path:
        database = load_dbc(path)
    return CanDecoder(
        name, told["title"], database, rates_Hz=tuple(map(float, told["rates_Hz"])), counter=told.get("counter"),
        match=told.get("match"),
    )  # fmt: skip
