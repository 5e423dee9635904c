"""Every CAN adapter that python-can knows, by its name: `can:pcan:PCAN_USBBUS1?bitrate=1000000`.

A thread reads the adapter and hands records over through a socket, so that the link can be waited for like any other
and does not lag.  That is for convenience, not for the fast loop: Linux interfaces have `hil.wire.can_link`.
"""

import importlib
import inspect
import logging
import select
import socket
import threading
import time
from collections.abc import Iterable
from concurrent.futures import Future, wait
from typing import Any

import can
from can.interfaces import BACKENDS

from hil.wire.can_format import BRS, CAN, FDF, HEAD, RECORD_SIZE, CanFormat
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import HOST, FrameFormat, Sender
from hil.wire.link import Claim
from hil.wire.link_name import CanAdapter, CanInterface

LISTEN_S = 0.05
"""How long a host listens for another one before it speaks."""

OPEN_S = 6.0
"""How long a bus may take to open."""

_LOOK_S = 0.1  # how often the thread looks whether it is still wanted
_BUFFER = 1 << 20
_OURS = frozenset(
    {"self", "args", "kwargs", "channel", "interface", "fd", "protocol", "can_filters", "timing", "state"}
)
_TIMING = (
    *("bitrate", "data_bitrate", "f_clock", "f_clock_mhz"),
    *(f"{phase}_{name}" for phase in ("nom", "data") for name in ("brp", "tseg1", "tseg2", "sjw", "sam")),
)
_REFUSALS = (can.CanError, ImportError, OSError, ValueError, TypeError, AttributeError, NameError, NotImplementedError)

logging.getLogger("can").addHandler(logging.NullHandler())  # what it has to say comes as an error of ours


class AdapterLink:
    """One end of the conversation on a python-can bus, which it owns."""

    def __init__(self, bus: can.BusABC, name: str, node: int, sender: Sender, claim: Claim) -> None:
        self.name = name
        self.url = name
        self.format: FrameFormat = CanFormat(node, sender)
        self.advice = f"is the board on, is it node {node}, and is the bit timing right?"
        self.arrived_ns = 0
        self.drop_when_full = False
        self._bus = bus
        self._claim = claim
        self._failure = ""
        self._closing = False
        self._records, self._source = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._records.setblocking(False)
        self._records.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._source.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        self._reader = threading.Thread(target=self._read, name=name, daemon=True)
        self._reader.start()

    def fileno(self) -> int:
        """Readable when frames are there; -1 once closed."""
        return self._records.fileno()

    def send(self, data: bytes) -> None:
        """Send every frame in `data`. Raises LinkClosed."""
        if self._closing:
            raise LinkClosed(f"{self.name}: the link is closed")
        for at in range(0, len(data), RECORD_SIZE):
            try:
                self._bus.send(message_of(data[at : at + RECORD_SIZE]), timeout=None if self.drop_when_full else 1.0)
            except (can.CanError, OSError) as error:
                raise LinkClosed(f"{self.name}: {_line(error)}") from None

    def receive(self, timeout_s: float | None) -> bytes:
        """All frames that have arrived; b"" if none came within `timeout_s` seconds (None: wait for ever). Raises
        LinkClosed."""
        if self._closing:
            raise LinkClosed(f"{self.name}: the link is closed")
        if not select.select([self._records], (), (), timeout_s)[0]:
            return b""
        records = []
        try:
            while record := self._records.recv(RECORD_SIZE):
                records.append(record)
        except BlockingIOError:
            return b"".join(records)
        if records:
            return b"".join(records)
        raise LinkClosed(f"{self.name}: {self._failure}")

    def offer(self, data: bytes | memoryview) -> int:
        """Send all of `data`: adapters do not tell whether they have room. Raises LinkClosed."""
        self.send(bytes(data))
        return len(data)

    def await_host(self) -> None:
        """Hosts come and go unseen; an adapter that failed has to be looked after. Raises LinkError."""
        raise LinkError(f"{self.name}: {self._failure}; see to the adapter and start again")

    def close(self) -> None:
        if not self._closing:
            self._closing = True
            self._records.shutdown(socket.SHUT_RDWR)  # or the thread may wait for ever for room that nobody makes
            self._reader.join()
            self._records.close()
            self._bus.shutdown()
            self._claim.release()

    def _read(self) -> None:
        """The thread: from the adapter to the socket until the link is closed or the adapter fails."""
        with self._source:
            while not self._closing:
                try:
                    message = self._bus.recv(_LOOK_S)
                    if message is not None and not message.is_error_frame:
                        self._source.send(record_of(message))
                except (can.CanError, OSError, ValueError) as error:
                    self._failure = _line(error)
                    return


def open_adapter(link: CanAdapter, sender: Sender) -> AdapterLink:
    """A link to or of the board that is `link.node` on a python-can bus.

    Raises:
        LinkError: no such interface or option, its driver is missing, it cannot be opened so, or another host is there.
    """
    name, node = link.url, link.node
    if link.interface == "socketcan":
        raise LinkError(f"{name}: Linux interfaces are opened by their own name: can:{link.channel}")
    _require_known(name, link)
    claim = Claim(
        f"can/{link.interface}:{link.channel}/{node}/{sender}",
        name,
        "another host on this machine has this link; end it there"
        if sender == HOST
        else f"another board serves node {node} here; take another node, such as ?node={node + 1}",
    )
    try:
        bus = _opened(name, link)
        try:
            if sender == HOST:
                _require_silence(bus, name, node)
            return AdapterLink(bus, name, node, sender, claim)
        except LinkError:
            bus.shutdown()
            raise
    except LinkError:
        claim.release()
        raise


def open_bus(name: str, link: CanInterface | CanAdapter) -> can.BusABC:
    """The python-can bus of a link, with CAN FD; `name` stands before an error. Raises LinkError, one line, if it
    cannot be opened."""
    if isinstance(link, CanInterface):
        return _opened(name, CanAdapter("socketcan", link.channel))
    _require_known(name, link)
    return _opened(name, link)


def _require_known(name: str, link: CanAdapter) -> None:
    """LinkError for an interface that python-can does not have, or an option that is none of it."""
    if link.interface not in can.VALID_INTERFACES:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise LinkError(f"{name}: python-can knows no interface {link.interface!r}; it knows {known}")
    known_options = _options_of(link.interface)
    for option, _ in link.options:
        if option not in known_options:
            raise LinkError(f"{name}: {option} is no option of {link.interface}; it has {', '.join(known_options)}")


def _options_of(interface: str) -> list[str]:
    """What can be said of a python-can bus in a link's name: what its class names, and the bit timing, which classes
    take without naming it."""
    named: Iterable[str]
    try:
        module, name = BACKENDS[interface]
        named = inspect.signature(getattr(importlib.import_module(module), name).__init__).parameters
    except (*_REFUSALS, KeyError):
        named = ()  # its driver is missing: opening it says so
    return sorted({*named, *_TIMING} - _OURS)


def _opened(name: str, link: CanAdapter) -> can.BusABC:
    extra: dict[str, Any] = {option: _value(value) for option, value in link.options}
    if link.interface == "virtual":
        extra["protocol"] = can.CanProtocol.CAN_FD
    else:
        extra["fd"] = True
    try:
        return _bus_within(
            OPEN_S, {"channel": link.channel, "interface": link.interface, "ignore_config": True, **extra}
        )
    except TimeoutError:
        raise LinkError(f"{name}: not open within {OPEN_S:g} s; does whatever serves the adapter answer?") from None
    except _REFUSALS as error:
        raise LinkError(f"{name}: {_line(error)}; is its driver installed, the adapter plugged in?") from None


def _bus_within(limit_s: float, how: dict[str, Any]) -> can.BusABC:
    """A bus that is opened by a thread: a driver, or a server that says nothing, may never come to an end. Raises
    TimeoutError, and what refuses it."""
    opened: Future[can.BusABC] = Future()

    def open_it() -> None:
        try:
            bus = can.Bus(**how)
        except Exception as error:  # noqa: BLE001 - of a thread: raised where it is waited for
            if opened.set_running_or_notify_cancel():
                opened.set_exception(error)
            return
        if opened.set_running_or_notify_cancel():
            opened.set_result(bus)
        else:
            bus.shutdown()  # too late

    threading.Thread(target=open_it, name="can.Bus", daemon=True).start()
    wait([opened], limit_s)
    if opened.cancel():
        raise TimeoutError
    return opened.result()


def message_of(record: bytes) -> can.Message:
    """A record as python-can has it."""
    identifier, length, flags = HEAD.unpack_from(record)
    return can.Message(
        arbitration_id=identifier,
        is_extended_id=False,
        is_fd=bool(flags & FDF),
        bitrate_switch=bool(flags & BRS),
        data=record[HEAD.size : HEAD.size + length],
    )


def record_of(message: can.Message) -> bytes:
    """A data frame of python-can as a record; its flags put other kinds of frames beyond the identifiers in use."""
    foreign = message.is_extended_id << 31 | message.is_remote_frame << 30
    flags = (BRS if message.bitrate_switch else 0) | (FDF if message.is_fd else 0)
    data = bytes(message.data)
    return (HEAD.pack(message.arbitration_id | foreign, len(data), flags) + data).ljust(RECORD_SIZE, b"\0")


def _require_silence(bus: can.BusABC, name: str, node: int) -> None:
    """Raise LinkError if another host on the bus is speaking to this node."""
    mask = CAN.identifier(0, CAN.nodes - 1, 1)
    until = time.monotonic() + LISTEN_S
    while (left := until - time.monotonic()) > 0:
        message = bus.recv(left)
        if message is not None and message.arbitration_id & mask == CAN.identifier(0, node, HOST):
            raise LinkError(f"{name}: another host on this bus is using node {node}; end it there")


def _value(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text.lower(), text)


def _line(error: BaseException) -> str:
    return str(error).partition("\n")[0].rstrip(".") or type(error).__name__
