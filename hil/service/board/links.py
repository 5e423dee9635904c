"""Which links a request may name: no path in it reaches the file system but a device, or a file of this bench."""

from pathlib import Path

from hil.emulation import is_emulated
from hil.errors import InputError
from hil.service.bench_files import found
from hil.service.service import Service
from hil.wire.links import parse_emulated


def allowed(service: Service, link: str) -> str:
    """`link` with the path of its scenario or key as it is here. Raises InputError where a request may not name it."""
    kind, _, place = link.partition(":")
    if is_emulated(link):
        board = parse_emulated(place)
        return f"{kind}:{board._replace(scenario=str(found(service.folder, 'scenario', board.scenario))).text}"
    if kind == "serial":
        port, mark, options = place.partition("?")
        if not str(Path(port).resolve()).startswith("/dev/"):
            raise InputError(f"serial:{port}: no device; give one below /dev, such as serial:/dev/ttyACM0")
        return f"serial:{port}{mark}{options}"
    if kind == "udp" and "key=" in place:
        before, _, rest = place.partition("key=")
        name, mark, after = rest.partition("&")
        return f"udp:{before}key={_own_file(service, name)}{mark}{after}"
    if kind in ("can", "udp"):
        return link
    raise InputError(f"{link}: no link; give serial:PORT, can:NAME, udp:GROUP:PORT, pty:SCENARIO or inproc:SCENARIO")


def _own_file(service: Service, name: str) -> Path:
    folder = service.folder.resolve().parent
    path = folder / name
    if "/" in name or not path.is_file():
        raise InputError(f"key={name}: no file of this bench; put it into {folder.name}/ and give its name")
    return path
