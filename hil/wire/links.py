"""Links by name: `serial:/dev/ttyUSB0`, `can:can0`, `udp:239.0.0.1:4242`, `inproc:examples/s-slow.scenario.toml`.

Others come from packages, as entry points of the group `hil.links`: a scheme, and a function that opens the host's end
of what stands behind it.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import parse_qsl

from hil.wire.errors import LinkError
from hil.wire.frame_format import BOARD, HOST, Sender
from hil.wire.link import BoardLink, Link
from hil.wire.spec import SPEC

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ENTRY_POINT_GROUP = "hil.links"


def open_link(url: str) -> Link:
    """Open the host's end of a link by name.

    `serial:PATH[?baud=N]` a serial port or the host's end of a pty; `can:NAME[?node=N]` a Linux CAN interface;
    `can:INTERFACE:CHANNEL[?node=N&…]` any other adapter, with the options python-can has for it;
    `udp:GROUP:PORT[?interface=ADDRESS&key=FILE]` a multicast group, on loopback unless an interface is named;
    `inproc:SCENARIO[?latency=TICKS&rate=HZ]` an emulated board in this process; any other scheme that a package brings.

    Raises:
        LinkError: unknown scheme or option, or the link cannot be opened; one line that names the link and
            the remedy.
    """
    scheme, _, rest = url.partition(":")
    brought = require_known(url)
    if scheme == "pty":
        raise LinkError(f"link {url!r}: starts a board of its own, and none was started; give the link that it serves")
    return (_OPENERS[scheme] if brought is None else _loaded(brought))(rest)


def require_known(url: str) -> "EntryPoint | None":
    """LinkError for a link of an unknown kind; nothing is opened. What brings a kind that another package does."""
    scheme, _, rest = url.partition(":")
    if rest and scheme in (*_OPENERS, "pty"):
        return None
    installed = _installed()
    if not rest or scheme not in installed:
        raise _unknown(url, [f"{name}:…" for name in (*_OPENERS, "pty", *sorted(installed))])
    return installed[scheme]


def _installed() -> dict[str, "EntryPoint"]:
    """The schemes of other packages."""
    from importlib.metadata import entry_points  # a third of the time that the wire takes to load

    return {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP) if entry.name not in _OPENERS}


def _loaded(entry: "EntryPoint") -> Callable[[str], Link]:
    try:
        opener: Callable[[str], Link] = entry.load()
    except Exception as error:  # whatever another package does wrong
        raise LinkError(
            f"link '{entry.name}:…': {entry.value} cannot be loaded: {error}; mend or remove the package that brings it"
        ) from error
    return opener


def open_board_link(url: str) -> BoardLink:
    """Open the board's end of a link by name: `pty`, or `can:…` and `udp:…` as in `open_link`. Raises as that."""
    if url == "pty":
        from hil.wire.pty_link import open_pty

        return open_pty()
    scheme, _, rest = url.partition(":")
    if scheme == "can" and rest:
        return _can(rest, BOARD)
    if scheme == "udp" and rest:
        return _udp(rest, BOARD)
    raise _unknown(url, ["pty", "can:…", "udp:…"])


def _unknown(url: str, known: list[str]) -> LinkError:
    return LinkError(f"link {url!r}: unknown kind of link; known are {', '.join(known)}")


def _options(rest: str) -> tuple[str, dict[str, str]]:
    place, _, query = rest.partition("?")
    return place, dict(parse_qsl(query, keep_blank_values=True))


def _serial(rest: str) -> Link:
    from hil.wire.serial_link import DEFAULT_BAUD, open_serial

    path, options = _options(rest)
    baud = options.pop("baud", str(DEFAULT_BAUD))
    if options or not baud.isascii() or not baud.isdigit() or int(baud) == 0:
        raise LinkError(f"link 'serial:{rest}': bad option; expected serial:PATH or serial:PATH?baud=921600")
    return open_serial(path, int(baud))


class CanPlace(NamedTuple):
    """Where a CAN link leads: `interface` is python-can's name of it, "" for a Linux interface."""

    interface: str
    channel: str
    node: int
    options: dict[str, str]


def parse_can(rest: str) -> CanPlace:
    """What stands behind `can:` in a link's name. Raises LinkError, one line."""
    place, options = _options(rest)
    number = options.pop("node", "0")
    if number not in map(str, range(SPEC.can.nodes)):
        raise LinkError(f"link 'can:{rest}': node {number}; expected 0 to {SPEC.can.nodes - 1}")
    interface, channel = place.split(":", 1) if ":" in place else ("", place)
    if options and not interface:
        raise LinkError(f"link 'can:{rest}': bad option; expected can:NAME or can:NAME?node=2")
    return CanPlace(interface, channel, int(number), options)


class EmulatedBoard(NamedTuple):
    """What stands behind `pty:` or `inproc:`: the scenario, and what of its board is another than it says."""

    scenario: str
    latency_ticks: int | None = None
    rate_Hz: float | None = None

    @property
    def changes(self) -> dict[str, int | float]:
        """What is another, by the name of its field."""
        return {name: value for name, value in self._asdict().items() if name != "scenario" and value is not None}

    @property
    def text(self) -> str:
        """As it stands in a link."""
        given = [f"{name.partition('_')[0]}={value:.10g}" for name, value in self.changes.items()]
        return f"{self.scenario}?{'&'.join(given)}" if given else self.scenario


def parse_emulated(rest: str) -> EmulatedBoard:
    """What stands behind `pty:` or `inproc:` in a link's name. Raises LinkError, one line."""
    scenario, options = _options(rest)
    latency, rate = options.pop("latency", None), options.pop("rate", None)
    try:
        if options or not scenario or not (latency is None or (latency.isascii() and latency.isdigit())):
            raise ValueError
        rate_Hz = None if rate is None else float(rate)
        if rate_Hz is not None and not 0.0 < rate_Hz < math.inf:
            raise ValueError
    except ValueError:
        raise LinkError(
            f"link {rest!r}: bad option; expected SCENARIO, or SCENARIO?latency=TICKS&rate=HZ; "
            "samples a SENSE are [loop] block of the bench file"
        ) from None
    return EmulatedBoard(scenario, None if latency is None else int(latency), rate_Hz)


def _can(rest: str, sender: Sender = HOST) -> BoardLink:
    where = parse_can(rest)
    if where.interface:
        from hil.wire.can_adapter import open_adapter

        return open_adapter(f"can:{rest}", *where[:3], sender, where.options)
    from hil.wire.can_link import open_can

    return open_can(where.channel, where.node, sender)


def _udp(rest: str, sender: Sender = HOST) -> BoardLink:
    from hil.wire.udp_link import open_udp

    place, options = _options(rest)
    interface, key = options.pop("interface", None), options.pop("key", None)
    if options or key == "":
        raise LinkError(
            f"link 'udp:{rest}': bad option; expected udp:GROUP:PORT or udp:GROUP:PORT?interface=ADDRESS&key=FILE"
        )
    return open_udp(place, interface, key, sender)


def _inproc(rest: str) -> Link:
    from hil.wire.inproc import open_inproc

    return open_inproc(rest)


_OPENERS: dict[str, Callable[[str], Link]] = {"serial": _serial, "can": _can, "udp": _udp, "inproc": _inproc}
