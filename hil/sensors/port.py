"""Where a sensor is: the name of a link, what stands behind it opened, bytes or frames."""

import time
from collections.abc import Sequence
from contextlib import closing
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from hil.errors import InputError
from hil.errors.input import loaded
from hil.sensors.adapter import GROUP, Adapter
from hil.sensors.declared import can_protocols, protocols
from hil.sensors.iio import IioGyro
from hil.sensors.stream_decoder import StreamDecoder
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
        piece = self._file.read(_PIECE)
        if not piece:
            raise LinkClosed(f"{self._path}: the file ends here")
        return piece

    def close(self) -> None:
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


WITHIN_S = 5.0
"""A line is told within so long."""

_ENOUGH = 3  # frames with a checksum that fits
_SILENT_S = 2.0
_SHORTEST_S = 0.35  # at one baud rate
_FILE_BYTES = 1 << 20


def usual_bauds() -> list[int]:
    """The baud rates of the declared protocols, those first that are the first of most."""
    order: dict[int, float] = {}
    for protocol in protocols().values():
        for place, baud in enumerate(protocol.bauds):
            order[baud] = order.get(baud, 0.0) + 2.0**-place
    return sorted(order, key=lambda baud: -order[baud])


def recognised(port: Port, link: str) -> Port:
    """The same port with the adapter, and the baud rate, of what speaks there. Raises LinkError that says what was
    heard: nothing, or what is none of the known ones.
    """
    if port.kind == "can":
        return port._replace(adapter=_on_bus(port, link))
    if port.kind == "iio":
        return port._replace(adapter=IioGyro(port.path))
    if port.kind == "replay":
        return port._replace(adapter=_in_file(port, link))
    bauds = [port.baud] if port.baud else usual_bauds()
    begin, heard = time.monotonic(), 0
    for place, baud in enumerate(bauds):
        with closing(open_source(port._replace(baud=baud))) as source:
            left = WITHIN_S - 0.4 - (time.monotonic() - begin)
            found, bytes_ = _listen(source, max(left / (len(bauds) - place), _SHORTEST_S), heard)
        heard += bytes_
        if found is not None:
            return port._replace(adapter=adapter_called(found.name, link), baud=baud)
        if not heard and time.monotonic() - begin >= _SILENT_S:
            raise LinkError(f"{link}: nothing was heard in {_SILENT_S:g} s; check supply and wiring, and that it sends")
        if time.monotonic() - begin > WITHIN_S - _SHORTEST_S:
            break
    raise LinkError(
        f"{link}: {heard} bytes were heard at {len(bauds)} baud rates ({', '.join(map(str, bauds))}), but no frame of "
        f"{', '.join(protocols())}; give ?baud= for another rate, or an adapter of your own"
    )


def _listen(source: Source, seconds: float, heard_before: int) -> tuple[StreamDecoder | None, int]:
    """Who spoke within so long; longer until there is a byte, as a silent line is not one of the wrong rate."""
    decoders = [StreamDecoder(one) for one in protocols().values()]
    begin, heard = time.monotonic(), 0
    while True:
        data = hear(source, 0.05)
        heard += len(data)
        for decoder in decoders if data else ():
            decoder.feed(data)
        spent = time.monotonic() - begin
        if (best := _best(decoders)) is not None and spent >= _SHORTEST_S / 2:
            return best, heard
        if spent >= (seconds if heard or heard_before else _SILENT_S):
            return None, heard


def _best(decoders: Sequence[StreamDecoder]) -> StreamDecoder | None:
    best = max(decoders, key=lambda one: (one.has_rates, one.understood))
    return best if best.frames >= _ENOUGH else None


def _in_file(port: Port, link: str) -> Any:
    decoders = [StreamDecoder(one) for one in protocols().values()]
    heard = 0
    with closing(open_source(port)) as source:
        assert isinstance(source, FileSource)
        try:
            while heard < _FILE_BYTES:
                data = source.receive(0.0)
                heard += len(data)
                for decoder in decoders:
                    decoder.feed(data)
        except LinkClosed:
            pass
    best = _best(decoders)
    if best is None:
        what = "is empty" if not heard else f"no frame of {', '.join(protocols())} in {heard} bytes"
        raise LinkError(f"{link}: {what}; a log of CAN frames goes to hil import --dbc")
    return adapter_called(best.name, link)


def _on_bus(port: Port, link: str) -> Any:
    decoders = [adapter_called(name, link) for name in can_protocols()]
    samples = [0] * len(decoders)
    identifiers: dict[int, int] = {}
    begin = time.monotonic()
    with closing(open_source(port)) as source:
        while time.monotonic() - begin < WITHIN_S - 0.5:
            frames = hear(source, 0.05)
            for frame in frames:
                identifiers[frame.arbitration_id] = identifiers.get(frame.arbitration_id, 0) + 1
            for place, decoder in enumerate(decoders):
                samples[place] += len(decoder.feed(frames)) if decoder is not None else 0
            if max(samples) >= 2 * _ENOUGH:
                best = decoders[samples.index(max(samples))]
                assert best is not None
                return adapter_called(getattr(best, "name", ""), link)
    if not identifiers:
        raise LinkError(f"{link}: no frame in {WITHIN_S - 0.5:g} s; check bit rate, termination and supply")
    shown = ", ".join(f"0x{one:X}" for one in sorted(identifiers)[:8]) + (", …" if len(identifiers) > 8 else "")
    raise LinkError(
        f"{link}: {sum(identifiers.values())} frames of {len(identifiers)} identifiers ({shown}), none of "
        f"{', '.join(can_protocols())}; say what they are by --dbc FILE"
    )
