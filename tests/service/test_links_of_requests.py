"""Links that a request may name (docs/security.md, 21): no text reaches a file or the network outside the lists."""

import os
import socket
import string
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hil.errors import InputError
from hil.service.board.links import allowed, is_port
from hil.service.security.audit import Audit
from hil.service.security.hosts import Hosts
from hil.service.security.tokens import Tokens
from hil.service.service import PRIVATE, Service
from hil.wire.errors import LinkError
from hil.wire.key_file import make_key
from hil.wire.link_name import CanAdapter, CanInterface, Emulated, SerialPort, UdpGroup, parse_link

LISTED = ("can:slcan:/dev/ttyACM7?bitrate=500000", "serial:/tmp/a-port")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Service:
    folder = tmp_path_factory.mktemp("bench") / "runs"
    (folder / PRIVATE).mkdir(parents=True)
    make_key(folder.parent / "own.key")
    links = tuple(parse_link(link) for link in LISTED)
    return Service(folder, Hosts(local=True), Tokens(), Audit(folder / PRIVATE / "audit.jsonl"), links)


REFUSED = (
    "can:slcan:socket://127.0.0.1:80",
    "can:slcan:/etc/shadow",
    "can:slcan:/dev/ttyACM7",
    "can:slcan:/dev/ttyACM7?bitrate=1000000",
    "can:udp_multicast:ff15::1",
    "can:udp_multicast:239.74.163.2?port=43113",
    "can:socketcand:can0?host=10.0.0.1&port=29536",
    "can:virtual:x",
    "can:serial:/etc/passwd",
    "can:nosuchcan",
    "udp:239.0.0.1:4242?interface=127.0.0.1&k%65y=/etc/passwd",
    "udp:239.0.0.1:4242?key=own.key&key=/etc/passwd",
    "udp:239.0.0.1:4242?key=/etc/passwd",
    "udp:239.0.0.1:4242?key=%2Fetc%2Fpasswd",
    "udp:239.0.0.1:4242?key=..",
    "udp:239.0.0.1:4242?key=../bench/own.key",
    "udp:239.0.0.1:4242?interface=192.0.2.1",
    "serial:/etc/shadow",
    "serial:/dev/watchdog",
    "serial:/dev/mem",
    "serial:/dev/null",
    "serial:/dev/tty",
    "serial:/dev/pts/../null",
    "serial:/dev/fd/0",
    "serial:/dev/ttyS999",
    "serial:socket://127.0.0.1:80",
    "serial:rfc2217://127.0.0.1:80",
    "serial:/dev/tty\0",
    "pty:/etc/passwd",
    "inproc:../../x",
    "file:///etc/passwd",
)


@pytest.mark.parametrize("text", REFUSED)
def test_what_no_request_may_name(service: Service, text: str) -> None:
    with pytest.raises((InputError, LinkError)) as refused:
        allowed(service, text)
    assert str(refused.value).isprintable()


def test_what_the_operator_listed_is_allowed_exactly_so(service: Service) -> None:
    for link in LISTED:
        assert allowed(service, link) == parse_link(link)
    key = service.folder.resolve().parent / "own.key"
    link = allowed(service, "udp:239.0.0.1:4242?interface=192.0.2.1&key=own.key")
    assert link == UdpGroup("239.0.0.1:4242", "192.0.2.1", str(key))
    assert allowed(service, "udp:239.0.0.1:4242") == UdpGroup("239.0.0.1:4242")
    assert allowed(service, "can:lo?node=2") == CanInterface("lo", 2)  # which is no CAN, as opening it says
    assert isinstance(allowed(service, "pty:s-slow"), Emulated)


def test_links_of_bench_files_are_their_operators(service: Service) -> None:
    own = service.folder.parent / "own.bench.toml"
    text = (Path("examples") / "s-slow.bench.toml").read_text()
    link = "can:slcan:/dev/ttyACM8"
    with pytest.raises(InputError, match="hil serve --link 'can:slcan:/dev/ttyACM8'"):
        allowed(service, link)
    assert '[link]\nurl = "pty:s-slow"' in text or "pty:" in text
    own.write_text(text.replace('"pty:s-slow.scenario.toml"', f'"{link}"').replace('"pty:s-slow"', f'"{link}"'))
    assert allowed(service, link) == CanAdapter("slcan", "/dev/ttyACM8")
    own.unlink()


def test_a_pty_is_a_port_unless_somebody_types_there() -> None:
    ours, theirs = os.openpty()
    path = os.ttyname(theirs)
    try:
        assert is_port(path)
        child = os.fork()
        if not child:  # it becomes the terminal of a session
            os.setsid()
            os.close(os.open(path, os.O_RDWR))
            os.read(ours, 1)
            os._exit(0)
        for _ in range(200):
            if not is_port(path):
                break
        else:
            pytest.fail("the terminal of a program counts as a port")
        os.write(theirs, b"x")
        os.waitpid(child, 0)
    finally:
        os.close(ours)
        os.close(theirs)
    assert not is_port(path)


_PARTS = st.sampled_from(
    [
        "serial:", "can:", "udp:", "pty:", "inproc:", "slcan:", "socketcand:", "udp_multicast:", "socket://", "?",
        "&", "key=", "k%65y=", "interface=", "baud=9600", "node=1", "/etc/passwd", "/dev/", "ttyS0", "pts/0",
        "..", "/", "%2f",
        "%00", "\0", "239.0.0.1:4242", "127.0.0.1", "192.0.2.1", "own.key", "s-slow", "=", "host=", "channel=", "port=",
    ]
)  # fmt: skip
_TEXTS = st.one_of(st.lists(_PARTS, max_size=10).map("".join), st.text(string.printable, max_size=40))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=400)
@given(text=_TEXTS)
def test_no_text_leads_outside(service: Service, text: str) -> None:
    """What is allowed is of few kinds, each of which can open what it says and nothing else."""
    try:
        link = allowed(service, text)
    except (InputError, LinkError):
        return
    beside = service.folder.resolve().parent
    match link:
        case Emulated(_, scenario):
            assert scenario.endswith(".scenario.toml")
            assert Path(scenario).is_file()
        case SerialPort(path):
            assert is_port(path) or link.url in LISTED
        case CanInterface(channel):
            assert channel in [name for _, name in socket.if_nameindex()]
        case UdpGroup(_, interface, key):
            assert (interface or "127.0.0.1") == "127.0.0.1" if key is None else Path(key).parent == beside
        case _:
            assert link.url in LISTED
