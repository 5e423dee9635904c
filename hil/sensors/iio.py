"""A gyro behind a Linux IIO daemon (`iiod`), as Analog Devices' ADIS16xxx are: `iio:HOST`, over the network.

The daemon speaks lines of text: a command, then a number, the length or an error, then so many bytes. Commands, masks
and replies after libiio's own client (iiod-client.c); formats of scan elements after its XML.
"""

import re
import socket
import xml.etree.ElementTree as ET
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from hil.records.layout import Column
from hil.sensors.adapter import Sample
from hil.wire.errors import LinkClosed, LinkError

PORT = 30431
_TIMEOUT_S = 3.0
_ROWS = 8  # samples of a buffer
_FORMAT = re.compile(r"(be|le):([suSU])(\d+)/(\d+)(?:X\d+)?>>(\d+)")
_KINDS = {"anglvel": ("rate", "rad/s", 1.0), "accel": ("acc", "m/s²", 1.0), "temp": ("temp", "°C", 1e-3)}


class _Element(NamedTuple):
    """A value in a buffer: its name, NumPy type, bits to be shifted off on both sides, column and offset in counts."""

    name: str
    type: str
    left: int
    right: int
    column: Column | None
    offset: float


class IioGyro:
    """Both ends of it: `receive` gives whole buffers of bytes, `feed` the samples in them; see `Adapter`, `Source`."""

    baud = crc_errors = skipped = 0
    rates_Hz: tuple[float, ...] = ()

    def __init__(self, place: str) -> None:
        """Connects. Raises LinkError for a host that does not answer, and where no device has angular rates."""
        host, _, port = place.partition(":")
        self._place, self._rest = f"iio:{place}", b""
        try:
            self._line = socket.create_connection((host, int(port or PORT)), _TIMEOUT_S)
        except (OSError, ValueError) as error:
            raise LinkError(f"{self._place}: {error}; does iiod run there?") from None
        try:
            self._find(self._answer("PRINT"))
        except LinkError:
            self._line.close()
            raise
        self.counter_size, self.counter_Hz = (1 << 32, 1e6) if self._timed else (256, 0.0)
        self.counts_itself = not self._timed
        self._count, self._opened = 0, False

    def _find(self, xml: bytes) -> None:
        try:
            devices = ET.fromstring(xml.decode()).iter("device")
        except (ET.ParseError, UnicodeDecodeError) as error:
            raise LinkError(f"{self._place}: what it says of itself is no XML: {error}") from None
        for device in devices:
            scanned = [(one, one.find("scan-element")) for one in device.iter("channel")]
            found = sorted(((int(scan.get("index", 0)), one, scan) for one, scan in scanned if scan is not None),
                           key=lambda each: each[0])  # fmt: skip
            if any(one.get("id", "").startswith("anglvel") for _, one, _ in found):
                self._device, self.name = device.get("id", ""), device.get("name", "iio")
                self.title = f"{self.name} by IIO"
                self._elements = [self._element(one, scan) for _, one, scan in found]
                self._mask = sum(1 << index for index, _, _ in found)
                self._timed = any(one.name == "timestamp" for one in self._elements)
                self._dtype = np.dtype({"names": [one.name for one in self._elements],
                                        "formats": [one.type for one in self._elements]}, align=True)  # fmt: skip
                self.channels = tuple(one.column for one in self._elements if one.column is not None)
                return
        raise LinkError(f"{self._place}: none of its devices has a buffer of angular rates (anglvel)")

    def _element(self, channel: ET.Element, scan: ET.Element) -> _Element:
        name = channel.get("id", "")
        told = _FORMAT.fullmatch(scan.get("format", ""))
        if told is None:
            raise LinkError(f"{self._place}: {name}: format {scan.get('format')!r} of a scan element is not known")
        order, sign, bits, storage, shift = told.groups()
        left = int(storage) - int(bits) - int(shift)
        kind = f"{'>' if order == 'be' else '<'}{'i' if sign in 'sS' else 'u'}{int(storage) // 8}"
        stem, _, axis = name.partition("_")
        if stem.rstrip("0123456789") not in _KINDS:
            return _Element(name, kind, left, int(shift), None, 0.0)
        called, unit, factor = _KINDS[stem.rstrip("0123456789")]
        scale = float(scan.get("scale") or self._attribute(name, "scale")) * factor
        offset = (
            float(self._attribute(name, "offset")) if channel.find("attribute[@name='offset']") is not None else 0.0
        )
        column = Column(f"{called}_{axis}_code" if axis else f"{called}_code", "f8", unit, scale)
        return _Element(name, kind, left, int(shift), column, offset)

    def receive(self, timeout_s: float | None) -> bytes:
        """The next buffer. Raises LinkClosed."""
        size = self._dtype.itemsize * _ROWS
        if not self._opened:
            self._number(f"OPEN {self._device} {_ROWS} {self._mask:08x}")
            self._opened = True
        got = b""
        count = self._number(f"READBUF {self._device} {size}")
        self._exactly(9)  # the mask, in hex
        got += self._exactly(count)
        return got

    def feed(self, data: bytes) -> list[Sample]:
        buffer = self._rest + data
        whole = len(buffer) // self._dtype.itemsize
        rows = np.frombuffer(buffer, self._dtype, whole)
        self._rest = buffer[whole * self._dtype.itemsize :]
        values = {one.name: rows[one.name] << one.left >> (one.left + one.right) for one in self._elements}
        samples = []
        for row in range(whole):
            self._count += 1
            counter = int(values["timestamp"][row]) // 1000 if self._timed else self._count
            codes = tuple(float(values[one.name][row]) + one.offset for one in self._elements if one.column is not None)
            samples.append(Sample(counter % self.counter_size, codes, 0, -1))
        return samples

    def complaints(self, status: int) -> list[str]:
        return []

    def close(self) -> None:
        self._line.close()

    def _attribute(self, channel: str, name: str) -> str:
        return self._answer(f"READ {self._device} INPUT {channel} {name}").decode().strip("\0\n ")

    def _answer(self, command: str) -> bytes:
        answer = self._exactly(self._number(command))
        self._exactly(1)  # a line end
        return answer

    def _number(self, command: str) -> int:
        """Send a command; its answer's number. Raises LinkError for an error of the daemon's."""
        self._do(partial(self._line.sendall, command.encode() + b"\r\n"))
        told = b""
        while not told.endswith(b"\n"):
            told += self._exactly(1)
        if not re.fullmatch(rb"-?\d+\n", told) or int(told) < 0:
            raise LinkError(
                f"{self._place}: {command.split()[0]} was answered with {told.strip().decode(errors='replace')}"
            )
        return int(told)

    def _exactly(self, count: int) -> bytes:
        got = b""
        while len(got) < count:
            piece: bytes = self._do(partial(self._line.recv, count - len(got)))
            if not piece:
                raise LinkClosed(f"{self._place}: the daemon hung up")
            got += piece
        return got

    def _do(self, action: Any) -> Any:
        try:
            return action()
        except OSError as error:
            raise LinkClosed(f"{self._place}: {error}") from None
