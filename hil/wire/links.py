"""Links by name, opened: `serial:/dev/ttyUSB0`, `can:can0`, `udp:239.0.0.1:4242`, `inproc:s-slow.scenario.toml`.

What a name says stands in `hil.wire.link_name`.  Other links come from packages, as entry points of the group
`hil.links`: a scheme, and a function that opens the host's end of what stands behind it.
"""

from collections.abc import Callable

from hil.wire.errors import LinkError
from hil.wire.frame_format import BOARD, HOST, Sender
from hil.wire.link import BoardLink, Link
from hil.wire.link_name import (
    Brought,
    CanAdapter,
    CanInterface,
    Emulated,
    LabgridPlace,
    LinkName,
    SerialPort,
    UdpGroup,
    installed,
    parse_link,
)


def open_link(link: str | LinkName) -> Link:
    """Open the host's end of a link.

    `serial:PATH[?baud=N]` a serial port or the host's end of a pty; `can:NAME[?node=N]` a Linux CAN interface;
    `can:INTERFACE:CHANNEL[?node=N&…]` any other adapter, with the options python-can has for it;
    `udp:GROUP:PORT[?interface=ADDRESS&key=FILE]` a multicast group, on loopback unless an interface is named;
    `inproc:SCENARIO[?latency=TICKS&rate=HZ]` an emulated board in this process; any other scheme that a package brings.

    Raises:
        LinkError: unknown scheme or option, or the link cannot be opened; one line that names the link and
            the remedy.
    """
    match parsed(link):
        case SerialPort() as port:
            from hil.wire.serial_link import open_serial

            return open_serial(port.path, port.baud)
        case CanInterface() | CanAdapter() as bus:
            return _can(bus, HOST)
        case UdpGroup() as group:
            from hil.wire.udp_link import open_udp

            return open_udp(group, HOST)
        case Emulated("inproc") as board:
            from hil.wire.inproc import open_inproc

            return open_inproc(board)
        case Emulated() as board:
            raise LinkError(
                f"link {board.url!r}: starts a board of its own, and none was started; give the link that it serves"
            )
        case LabgridPlace() as place:
            raise LinkError(f"link {place.url!r}: has to be acquired first; give it to hil run, or the link behind it")
        case Brought() as brought:
            return _loaded(brought)(brought.rest)


def parsed(link: str | LinkName) -> LinkName:
    """A link by its name, or as it was parsed. Raises as `parse_link`."""
    return parse_link(link) if isinstance(link, str) else link


def open_board_link(text: str) -> BoardLink:
    """Open the board's end of a link by name: `pty`, or `can:…` and `udp:…` as in `open_link`. Raises as that."""
    if text == "pty":
        from hil.wire.pty_link import open_pty

        return open_pty()
    if text.startswith(("can:", "udp:")):
        match parse_link(text):
            case CanInterface() | CanAdapter() as bus:
                return _can(bus, BOARD)
            case UdpGroup() as group:
                from hil.wire.udp_link import open_udp

                return open_udp(group, BOARD)
    raise LinkError(f"link {text!r}: unknown kind of link; known are pty, can:…, udp:…")


def _can(bus: CanInterface | CanAdapter, sender: Sender) -> BoardLink:
    if isinstance(bus, CanAdapter):
        from hil.wire.can_adapter import open_adapter

        return open_adapter(bus, sender)
    from hil.wire.can_link import open_can

    return open_can(bus.channel, bus.node, sender)


def _loaded(brought: Brought) -> Callable[[str], Link]:
    entry = installed()[brought.scheme]
    try:
        opener: Callable[[str], Link] = entry.load()
    except Exception as error:  # whatever another package does wrong
        raise LinkError(
            f"link '{entry.name}:…': {entry.value} cannot be loaded: {error}; mend or remove the package that brings it"
        ) from error
    return opener
