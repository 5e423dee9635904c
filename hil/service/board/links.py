"""Which links a request may name: what this bench has, and what its operator listed. Nothing else is opened.

Without being listed: an emulated board of a scenario of this bench, a serial port that is there, a CAN interface of the
kernel, a UDP group on loopback or with a key that lies beside the runs.  Listed are links of `hil serve --link` and
those of the bench files of this bench.
"""

import os
import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from hil.bench import Bench, load_any_bench
from hil.errors import InputError
from hil.sensors.port import find_port
from hil.service.bench_files import files, found
from hil.service.service import Service
from hil.wire.errors import LinkError
from hil.wire.link_name import LOOPBACK, CanInterface, Emulated, LinkName, SerialPort, UdpGroup, parse_link


def allowed(service: Service, text: str) -> LinkName:
    """The link of that name, with the path of its scenario or key as it is here. Raises InputError, or LinkError for
    what is no link, where a request may not name it.
    """
    link = parse_link(text)
    if isinstance(link, Emulated):
        return replace(link, scenario=str(found(service.folder, "scenario", link.scenario)))
    if link in service.links or link in _of_benches(service.folder):
        return link
    match link:
        case SerialPort(path):
            if not is_port(path):
                raise InputError(f"{link.url}: no serial port of this machine; {_listing(link)}")
        case CanInterface(channel):
            if channel not in (name for _, name in socket.if_nameindex()):
                raise InputError(f"{link.url}: no CAN interface of this machine; {_listing(link)}")
        case UdpGroup(_, interface, key):
            if key is not None:
                return replace(link, key=str(_own_file(service, key)))
            if interface not in (None, LOOPBACK):
                raise InputError(f"{link.url}: leaves this machine without a key; give one with &key=NAME")
        case _:
            raise InputError(f"{link.url}: not of this bench; {_listing(link)}")
    return link


def require_sensor(link: str) -> None:
    """InputError where a request may not name that link of a sensor: no adapter of that name, no serial port here."""
    port = find_port(link)
    if port.kind == "can":
        bus = parse_link(port.path)
        if not isinstance(bus, CanInterface) or bus.channel not in (name for _, name in socket.if_nameindex()):
            raise InputError(f"{link}: no CAN interface of this machine; bring it up")
    elif port.kind != "serial" or not is_port(port.path):
        raise InputError(f"{link}: {port.path} is no serial port of this machine; connect the sensor")


def is_port(path: str) -> bool:
    """Whether that is a serial port: a device that the system lists as one, or a pty that is nobody's terminal."""
    from serial.tools import list_ports

    real = os.path.realpath(path)
    if not path.startswith("/dev/"):
        return False
    if Path(real).parent == Path("/dev/pts"):
        with suppress(OSError):
            return Path(real).stat().st_rdev not in _terminals()
        return False
    return real in {os.path.realpath(port.device) for port in list_ports.comports(include_links=True)}


def _terminals() -> set[int]:
    """Devices that programs have as their terminal: what is typed there is not for a bench."""
    return set(_told_terminals())


def _told_terminals() -> Iterator[int]:
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):  # it has ended
            number = int(entry.read_text().rpartition(")")[2].split()[4])
            yield os.makedev((number >> 8) & 0xFFF, (number & 0xFF) | ((number >> 12) & 0xFFF00))


def _of_benches(folder: Path) -> Iterator[LinkName]:
    """Links that the bench files of this bench name: their author operates it."""
    for path in files(folder, "bench").values():
        with suppress(InputError, LinkError):
            bench = load_any_bench(path)
            if isinstance(bench, Bench) and bench.link.url is not None:
                yield parse_link(bench.link.url)


def _listing(link: LinkName) -> str:
    return f"connect it, or have it listed: hil serve --link '{link.url}'"


def _own_file(service: Service, name: str) -> Path:
    folder = service.folder.resolve().parent
    path = folder / name
    if "/" in name or name in (".", "..") or not path.is_file():
        raise InputError(f"key={name}: no file of this bench; put it into {folder.name}/ and give its name")
    return path
