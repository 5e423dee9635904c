"""What the name of a link says, parsed once: one type for each kind, whose `url` is the name that says the same.

Nothing is opened here.  What is not on the list (a scheme, an option, an option twice or in disguise, a control
character) is refused; code that opens a link, or permits it, goes by the type and never by the text.
"""

import ipaddress
import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal
from urllib.parse import unquote

from hil.wire.errors import LinkError
from hil.wire.spec import SPEC

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ENTRY_POINT_GROUP = "hil.links"
DEFAULT_BAUD = 3_000_000
"""Enough for 4 kHz sample by sample; USB devices and ptys ignore it."""
LOOPBACK = "127.0.0.1"
"""The network interface where none is named."""
LONGEST = 4096
"""Characters of a name; a path has at most as many."""

_OPTION = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_NUMBER = re.compile(r"[0-9]{1,18}")
_INTERFACE = re.compile(r"[a-z][a-z0-9_-]*")
_SCHEMES = ("serial", "can", "udp", "inproc", "pty", "labgrid")
_PLACE = re.compile(r"[A-Za-z0-9_.+-]{1,100}")


@dataclass(frozen=True)
class SerialPort:
    """`serial:PATH[?baud=N]`: a serial port, or the host's end of a pty."""

    path: str
    baud: int = DEFAULT_BAUD

    @property
    def url(self) -> str:
        return f"serial:{self.path}" + _query({} if self.baud == DEFAULT_BAUD else {"baud": str(self.baud)})


@dataclass(frozen=True)
class CanInterface:
    """`can:NAME[?node=N]`: a CAN interface of the kernel."""

    channel: str
    node: int = 0

    @property
    def url(self) -> str:
        return f"can:{self.channel}" + _query(_node(self.node))


@dataclass(frozen=True)
class CanAdapter:
    """`can:INTERFACE:CHANNEL[?node=N&…]`: what else python-can drives; `options` are those of its `can.Bus`."""

    interface: str
    channel: str
    node: int = 0
    options: tuple[tuple[str, str], ...] = ()

    @property
    def url(self) -> str:
        return f"can:{self.interface}:{self.channel}" + _query({**_node(self.node), **dict(self.options)})


@dataclass(frozen=True)
class UdpGroup:
    """`udp:GROUP:PORT[?interface=ADDRESS&key=FILE]`: `place` is GROUP:PORT."""

    place: str
    interface: str | None = None
    key: str | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Group and port. Raises LinkError where it is none."""
        group, _, port = self.place.rpartition(":")
        with suppress(ValueError):
            if ipaddress.IPv4Address(group).is_multicast and _NUMBER.fullmatch(port) and 0 < int(port) < 65535:
                return group, int(port)
        raise LinkError(f"{self.url}: expected a multicast group and a port, such as udp:239.0.0.1:4242")

    @property
    def local(self) -> str:
        """Address of the network interface. Raises LinkError where it is none."""
        with suppress(ValueError):
            local = ipaddress.IPv4Address(LOOPBACK if self.interface is None else self.interface)
            if not (local.is_unspecified or local.is_multicast):
                return str(local)
        raise LinkError(f"{self.url}: expected the address of one network interface, such as ?interface={LOOPBACK}")

    @property
    def url(self) -> str:
        given = {"interface": self.interface, "key": self.key}
        return f"udp:{self.place}" + _query({name: value for name, value in given.items() if value is not None})


@dataclass(frozen=True)
class Emulated:
    """`pty:SCENARIO`, `inproc:SCENARIO`, both with [?latency=TICKS&rate=HZ]: a board that is started for the link, and
    what of it is another than its scenario says; in this process with [emulator=NAME], which package's it is.
    """

    kind: Literal["pty", "inproc"]
    scenario: str
    latency_ticks: int | None = None
    rate_Hz: float | None = None
    emulator: str | None = None

    @property
    def changes(self) -> dict[str, int | float]:
        given = {"latency_ticks": self.latency_ticks, "rate_Hz": self.rate_Hz}
        return {name: value for name, value in given.items() if value is not None}

    @property
    def url(self) -> str:
        given = {name.partition("_")[0]: _written(value) for name, value in self.changes.items()}
        given |= {} if self.emulator is None else {"emulator": self.emulator}
        return f"{self.kind}:{self.scenario}" + _query(given)


@dataclass(frozen=True)
class LabgridPlace:
    """`labgrid:PLACE`: a place of labgrid, which is acquired for as long as its board is used."""

    place: str

    @property
    def url(self) -> str:
        return f"labgrid:{self.place}"


@dataclass(frozen=True)
class Brought:
    """A link of a kind that another package brings, which reads `rest` itself."""

    scheme: str
    rest: str

    @property
    def url(self) -> str:
        return f"{self.scheme}:{self.rest}"


LinkName = SerialPort | CanInterface | CanAdapter | UdpGroup | LabgridPlace | Emulated | Brought


def parse_link(text: str) -> LinkName:
    """What the name of a link says. Raises LinkError, one line that shows what is wrong with it."""
    require_visible(text)
    scheme, _, rest = text.partition(":")
    match scheme if rest else "":
        case "serial":
            return serial_port(text, rest, "serial:PATH or serial:PATH?baud=921600", DEFAULT_BAUD)
        case "can":
            return _can(text, rest)
        case "udp":
            return _udp(text, rest)
        case "labgrid" if _PLACE.fullmatch(rest) and not rest.startswith("-"):
            return LabgridPlace(rest)
        case "labgrid":
            raise LinkError(f"link {text!r}: no name of a place; expected labgrid:PLACE, of letters, digits and _.+-")
        case "pty" | "inproc" as kind:
            return _emulated(text, kind, rest)
        case _ if rest and scheme in installed():
            return Brought(scheme, rest)
        case _:
            raise _unknown(text)


def require_visible(text: str) -> None:
    """LinkError for a name that is longer than any, or has what nobody sees."""
    if len(text) > LONGEST:
        raise LinkError(f"link '{text[:40]}…': {len(text)} characters; no link has more than {LONGEST}")
    if not text.isprintable():
        raise LinkError(f"link {text!a}: has a control character; write it without")


def installed() -> dict[str, "EntryPoint"]:
    from importlib.metadata import entry_points  # a third of the time that the wire takes to load

    return {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP) if entry.name not in _SCHEMES}


def _unknown(text: str) -> LinkError:
    known = ", ".join(f"{name}:…" for name in (*_SCHEMES, *sorted(installed())))
    return LinkError(f"link {text!r}: unknown kind of link; known are {known}")


def serial_port(text: str, rest: str, expected: str, baud: int) -> SerialPort:
    """PATH[?baud=N], which is `rest` of the name `text`; `baud` is that of a name that gives none. Raises LinkError
    that names what is `expected`.
    """
    require_visible(text)
    path, options = options_of(text, rest, expected)
    given = options.pop("baud", str(baud))
    if options or not path or not _NUMBER.fullmatch(given) or int(given) == 0:
        raise LinkError(f"link {text!r}: bad option; expected {expected}")
    return SerialPort(path, int(given))


def _emulated(text: str, kind: Literal["pty", "inproc"], rest: str) -> Emulated:
    expected = "SCENARIO, or SCENARIO?latency=TICKS&rate=HZ; samples a SENSE are [loop] block of the bench file"
    scenario, options = options_of(text, rest, expected)
    latency, rate = options.pop("latency", None), options.pop("rate", None)
    emulator = options.pop("emulator", None) if kind == "inproc" else None
    rate_Hz = None
    if rate is not None:
        with suppress(ValueError):
            rate_Hz = float(rate)
    bad_rate = rate is not None and (rate_Hz is None or not 0.0 < rate_Hz < math.inf)
    if options or not scenario or bad_rate or not (latency is None or _NUMBER.fullmatch(latency)):
        raise LinkError(f"link {text!r}: bad option; expected {expected}")
    return Emulated(kind, scenario, None if latency is None else int(latency), rate_Hz, emulator)


def _can(text: str, rest: str) -> CanInterface | CanAdapter:
    expected = "can:NAME or can:NAME?node=2"
    place, options = options_of(text, rest, expected)
    number = options.pop("node", "0")
    if number not in map(str, range(SPEC.can.nodes)):
        raise LinkError(f"link {text!r}: node {number}; expected 0 to {SPEC.can.nodes - 1}")
    if ":" not in place:
        if options or not place or "/" in place:
            raise LinkError(f"link {text!r}: bad option; expected {expected}")
        return CanInterface(place, int(number))
    interface, channel = place.split(":", 1)
    if not _INTERFACE.fullmatch(interface) or not channel:
        raise LinkError(f"link {text!r}: expected can:INTERFACE:CHANNEL, such as can:pcan:PCAN_USBBUS1")
    return CanAdapter(interface, channel, int(number), tuple(sorted(options.items())))


def _udp(text: str, rest: str) -> UdpGroup:
    expected = "udp:GROUP:PORT or udp:GROUP:PORT?interface=ADDRESS&key=FILE"
    place, options = options_of(text, rest, expected)
    interface, key = options.pop("interface", None), options.pop("key", None)
    if options or "" in (interface, key):
        raise LinkError(f"link {text!r}: bad option; expected {expected}")
    link = UdpGroup(place, interface, key)
    _ = link.address, link.local
    return link


def options_of(text: str, rest: str, expected: str) -> tuple[str, dict[str, str]]:
    """What stands before the question mark in `rest` of a name, and the options behind it, each once and by its plain
    name. Raises LinkError that names what is `expected`.
    """
    place, mark, query = rest.partition("?")
    options: dict[str, str] = {}
    for part in query.split("&") if mark else ():
        name, sign, value = part.partition("=")
        if not _OPTION.fullmatch(name) or not sign:
            raise LinkError(f"link {text!r}: bad option; expected {expected}")
        if name in options:
            raise LinkError(f"link {text!r}: {name} is given twice; give it once")
        options[name] = _plain(text, value)
    return place, options


def _plain(text: str, value: str) -> str:
    """A value without the % signs that stand for other characters."""
    try:
        plain = unquote(value, errors="strict")
    except UnicodeDecodeError:
        raise LinkError(f"link {text!r}: {value} is not UTF-8 behind its % signs; write it plainly") from None
    if not plain.isprintable():
        raise LinkError(f"link {text!r}: {value} has a control character; write it without")
    return plain


def _query(options: Mapping[str, str]) -> str:
    escaped = {name: value.replace("%", "%25").replace("&", "%26") for name, value in options.items()}
    told = "&".join(f"{name}={value}" for name, value in escaped.items())
    return f"?{told}" if told else ""


def _written(value: float) -> str:
    """A number, short where that says the same."""
    short = f"{value:.10g}"
    return short if float(short) == value else repr(value)


def _node(node: int) -> dict[str, str]:
    return {"node": str(node)} if node else {}
