"""What an adapter for a vendor's framing is, and where adapters are found: the declared ones of the bench, and entry
points of the group `hil.boards`.

    [project.entry-points."hil.boards"]
    mygyro = "my_package.mygyro:MyGyro"

The name is the scheme of its links, `mygyro:/dev/ttyUSB0`, or `mygyro:can0` where its class has `link = "can"`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from hil.records.layout import Column

GROUP = "hil.boards"


class Sample(NamedTuple):
    """One datagram: `counter` as sent, a code per channel, the status, the sensor's own latency, -1 untold."""

    counter: int
    codes: tuple[float, ...]
    status: int
    latency_us: int


class Adapter(Protocol):
    """Decoder of one vendor's stream. It has no drive: its device is recorded, not driven.

    Attributes:
        title: the device, for people.
        channels: a column for each code of a sample, `i4` for whole numbers, else `f4` or `f8`, with its unit and
            scale. More may be appended while the first samples come.
        baud: of the line, unless the link says otherwise.
        counter_size: values the counter takes before it begins anew.
        rates_Hz: sample rates the sensor can be set to.
        crc_errors: datagrams dropped for their checksum.
        skipped: bytes that belonged to no datagram, before the first one not counted.

    It may have `link`, "serial" (where it has none) or "can"; `counter_Hz`, counts a second of a counter that is a
    clock; `counts_itself`, True where the counter is its own count, as the sensor sends none.
    """

    title: str
    baud: int
    counter_size: int
    rates_Hz: tuple[float, ...]
    crc_errors: int
    skipped: int

    @property
    def channels(self) -> tuple[Column, ...]: ...

    def feed(self, data: Any) -> Sequence[Sample]:
        """The samples that `data` completes, in order: bytes, or frames (`can.Message`). Never raises on what it
        reads."""
        ...

    def complaints(self, status: int) -> list[str]:
        """What a status complains of, in words; nothing for a healthy sample."""
        ...
