"""What an adapter for a vendor's framing is, and where adapters are found: entry points of the group `hil.boards`.

    [project.entry-points."hil.boards"]
    stim300 = "hil.sensors.stim300:Stim300"

The name of the entry point is the scheme of its links, `stim300:/dev/ttyUSB0`.
"""

from importlib.metadata import entry_points
from typing import NamedTuple, Protocol

from hil.errors import InputError
from hil.errors.package import loaded
from hil.records.layout import Column
from hil.wire.link_name import serial_port

GROUP = "hil.boards"


class Sample(NamedTuple):
    """One datagram: `counter` as sent, a code per channel, the status byte, the sensor's own latency."""

    counter: int
    codes: tuple[int, ...]
    status: int
    latency_us: int


class Adapter(Protocol):
    """Decoder of one vendor's stream. It has no drive: its device is recorded, not driven.

    Attributes:
        title: the device, for people.
        channels: a column for each code of a sample, `i4`, with its unit and scale.
        baud: of the line, unless the link says otherwise.
        counter_size: values the counter takes before it begins anew.
        rates_Hz: sample rates the sensor can be set to.
        crc_errors: datagrams dropped for their checksum.
        skipped: bytes that belonged to no datagram, before the first one not counted.
    """

    title: str
    channels: tuple[Column, ...]
    baud: int
    counter_size: int
    rates_Hz: tuple[float, ...]
    crc_errors: int
    skipped: int

    def feed(self, data: bytes) -> list[Sample]:
        """The samples that `data` completes, in order. Never raises on what it reads."""
        ...

    def complaints(self, status: int) -> list[str]:
        """What a status byte complains of, in words; nothing for a healthy sample."""
        ...


class Port(NamedTuple):
    """An adapter and the serial port it listens to."""

    adapter: Adapter
    path: str
    baud: int


def find_port(link: str) -> Port:
    """The adapter and port behind `NAME:PATH[?baud=N]`. Raises InputError that lists the names there are."""
    name, colon, rest = link.partition(":")
    known = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in known or not colon or not rest.partition("?")[0]:
        raise InputError(
            f"link {link!r}: no adapter of that name; known: {', '.join(sorted(known)) or 'none'} (NAME:PATH)"
        )
    adapter: Adapter = loaded(known[name], link)()
    expected = f"{name}:PATH or {name}:PATH?baud={adapter.baud}"
    port = serial_port(link, rest, expected, adapter.baud)
    return Port(adapter, port.path, port.baud)
