"""Where a sensor is: the name of a link, what stands behind it opened, bytes or frames."""

import time
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from hil.errors import InputError
from hil.errors.input import loaded
from hil.sensors.adapter import GROUP, Adapter
from hil.sensors.declared import can_protocols, protocols
from hil.sensors.iio import IioGyro
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.link_name import CanAdapter, CanInterface, options_of, parse_link, serial_port
from hil.wire.regular_file import what_instead
from hil.wire.serial_link import open_serial

if TYPE_CHECKING:
    import can

UNKNOWN = ("serial", "can", "replay", "iio")
"""Schemes behind which the sensor is recognised by what it says."""

_PIECE = 1 << 18  # of a file: many bytes at once are gone through fast


class Port(NamedTuple):
    """An adapter, None until it is recognised, and where it listens: a serial line, a CAN bus, a file, an IIO daemon.
    rate_Hz: samples a second of a file, where the sensor has no clock."""

    adapter: Adapter | None
    path: str
    baud: int = 0
    kind: str = "serial"
    rate_Hz: float | None = None


class Source(Protocol):
    """What an adapter is fed from."""

    def receive(self, timeout_s: float | None) -> Any:
        """What has arrived, empty where nothing came in time. Raises LinkClosed, of a file at its end."""
        ...

    def close(self) -> None:
        """Give it back."""
        ...


def adapter_called(name: str, link: str) -> Adapter | None:
    """A fresh adapter of that name, None where there is none. Raises InputError for one that cannot be loaded."""
    if name in protocols():
        from hil.sensors.stream_decoder import StreamDecoder

        return StreamDecoder(protocols()[name])
    if name in can_protocols():
        from hil.sensors.can_decoder import declared_decoder

        return declared_decoder(name)
    entry = next((one for one in entry_points(group=GROUP) if one.name == name), None)
    adapter: Adapter | None = None if entry is None else loaded(entry, link)()
    return adapter


def adapter_names() -> list[str]:
    """Every name there is."""
    return sorted({*protocols(), *can_protocols(), *(one.name for one in entry_points(group=GROUP))})


def find_port(link: str, dbc: Path | None = None) -> Port:
    """The adapter and port behind `NAME:PLACE`, NAME being an adapter's, or serial, can, replay, iio, behind which the
    sensor is recognised; dbc: what a sensor on CAN says. Raises InputError that lists the names there are.
    """
    name, colon, rest = link.partition(":")
    adapter = adapter_called(name, link) if colon and rest.partition("?")[0] else None
    if dbc is not None:
        from hil.sensors.can_decoder import CanDecoder, load_dbc

        if name != "can":
            raise InputError(f"{link}: --dbc {dbc} beside no CAN bus; record can:can0, or leave --dbc out")
        database = load_dbc(dbc)
        told = CanDecoder(dbc.stem, f"{dbc.name} on CAN", database)
        if not any(column.unit == "rad/s" for column in told.channels):
            raise InputError(f"{dbc}: none of its {len(database.messages)} messages has an angular rate (by its unit)")
        adapter = told
    if adapter is None and (name not in UNKNOWN or not rest.partition("?")[0]):
        raise InputError(
            f"link {link!r}: no adapter of that name; known: {', '.join(adapter_names())} (NAME:PATH), and "
            f"{', '.join(UNKNOWN)}, which find out"
        )
    if name == "can" or getattr(adapter, "link", "serial") == "can":
        return Port(adapter, f"can:{rest}", kind="can")
    if name == "replay":
        return _file(link, rest)
    if name == "iio":
        return Port(None, rest, kind="iio")
    baud = 0 if adapter is None else adapter.baud
    port = serial_port(link, rest, f"{name}:PATH or {name}:PATH?baud={baud or 921600}", baud or 1)
    return Port(adapter, port.path, baud if adapter is None and port.baud == 1 else port.baud)


def _file(link: str, rest: str) -> Port:
    expected = "replay:FILE or replay:FILE?rate=HZ&as=NAME"
    path, options = options_of(link, rest, expected)
    rate, name = options.pop("rate", None), options.pop("as", None)
    try:
        rate_Hz = None if rate is None else float(rate)
    except ValueError:
        rate_Hz = 0.0
    adapter = None if name is None else adapter_called(name, link)
    if options or not (rate_Hz is None or 0.0 < rate_Hz < 1e9) or (name is not None and adapter is None):
        raise InputError(f"link {link!r}: bad option; expected {expected}, NAME one of {', '.join(adapter_names())}")
    return Port(adapter, path, kind="replay", rate_Hz=rate_Hz)


def open_source(port: Port) -> Source:
    """What stands behind a port. Raises LinkError, one line, where it cannot be opened."""
    if port.kind == "can":
        return CanSource(port.path)
    if port.kind == "replay":
        return FileSource(Path(port.path))
    if isinstance(port.adapter, IioGyro):
        return port.adapter
    return open_serial(port.path, port.baud)


class CanSource:
    """Every frame of a bus, with its stamp; nothing is sent."""

    def __init__(self, name: str) -> None:
        from hil.wire.can_adapter import open_bus

        link = parse_link(name)
        if not isinstance(link, CanInterface | CanAdapter) or link.node:
            raise LinkError(f"{name}: expected can:NAME or can:INTERFACE:CHANNEL")
        self._name, self._bus = name, open_bus(name, link)

    def receive(self, timeout_s: float | None) -> "list[can.Message]":
        """As `Source.receive`."""
        import can  # here: it loads what reads MF4, pandas and all, where that is installed

        frames = []
        try:
            frame = self._bus.recv(timeout_s)
            while frame is not None:
                frames.append(frame)
                frame = self._bus.recv(0.0)
        except (can.CanError, OSError) as error:
            raise LinkClosed(f"{self._name}: {error}") from None
        return frames

    def close(self) -> None:
        """Give the bus back."""
        self._bus.shutdown()


class FileSource:
    """The bytes that a sensor once sent, from a file."""

    def __init__(self, path: Path) -> None:
        try:
            if (kind := what_instead(path)) is not None:
                raise LinkError(f"{path}: is {kind}, no file of bytes")
            self._file = path.open("rb")
        except OSError as error:
            raise LinkError(f"{path}: {getattr(error, 'strerror', None) or error}; give a file of a sensor's bytes"
                            ) from None  # fmt: skip
        self._path = path

    def receive(self, timeout_s: float | None) -> bytes:
        """As `Source.receive`."""
        piece = self._file.read(_PIECE)
        if not piece:
            raise LinkClosed(f"{self._path}: the file ends here")
        return piece

    def close(self) -> None:
        """Close it."""
        self._file.close()


def hear(source: Source, timeout_s: float) -> Any:
    """All that has arrived: how much time its samples stand for must not depend on when we looked."""
    data = source.receive(timeout_s)
    if isinstance(source, FileSource | IioGyro):
        return data
    until = time.monotonic() + timeout_s
    while data and time.monotonic() < until and (more := source.receive(0.0)):
        data = data + more
    return data
