"""docs/security.md, rule by rule, on a board in another process and sockets on 127.0.0.1."""

import errno
import hashlib
import itertools
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil import cli
from hil.testing.board_rules.conformance import PATIENCE_S, Board
from hil.wire import client, keyed, udp_link
from hil.wire.codec import type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError
from hil.wire.framing import encode_frame
from hil.wire.key_file import make_key, read_key
from hil.wire.keyed import LAST_COUNTER, Incoming, Outgoing
from hil.wire.links import open_board_link, open_link
from hil.wire.messages import (
    Arm,
    ClockMode,
    DriveForce,
    Hello,
    Identity,
    RegisterWrite,
    Safe,
    SafeReason,
    State,
    Status,
    TimeSync,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter
from tests.wire import attacking as attack
from tests.wire.served import emulated
from tools.keyed_example import BOARD_NONCE, HOST_NONCE, SECRET, example

from .attacker import LOOPBACK, InTheWay, attacking_socket, drained

GROUP = "239.255.42.70"
LIMIT = SPEC.registers["DRIVE_LIMIT"].id
ports = itertools.count(42700, 2)

ATTACKS = {
    "ARM": Arm(),
    "DRIVE_FORCE": DriveForce(32767, 32767, 5),
    "SAFE": Safe(SafeReason.HOST_REQUEST),
    "TIME_SYNC": TimeSync(1, 0),
    "HELLO": Hello(SPEC.protocol, SPEC.hash),
    "REGISTER_WRITE": RegisterWrite(LIMIT, 0.0),
}
"""What anybody in the group could say before there were sessions."""


def plain(message: object, seq: int = 3) -> bytes:
    """A frame without a key."""
    tx = Transmitter()
    tx.seq = seq
    return tx.encode(message, 0)


def status_of(host: Endpoint) -> Status:
    """STATUS as the board gives it to its host; brings it to SAFE."""
    return client.make_safe(host, SafeReason.HOST_REQUEST, PATIENCE_S)


def run_a_little(host: Endpoint) -> None:
    """Configure, arm in lockstep, drive a few rows, stop."""
    client.connect(host, PATIENCE_S)
    client.write_register(host, "CLOCK_MODE", ClockMode.LOCKSTEP, PATIENCE_S)
    client.write_register(host, "DRIVE_LIMIT", 1000, PATIENCE_S)
    client.arm(host, PATIENCE_S)
    rows = []
    for _ in range(10):
        until = time.monotonic() + PATIENCE_S
        while not rows and time.monotonic() < until:
            rows = host.receive_rows(0.1)
        host.send_drive(1, 1, rows[-1][0] + 1)
        rows = []
    assert status_of(host).state == State.SAFE


@pytest.fixture(scope="module")
def key(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("keys") / "board.key"
    make_key(path)
    return path


class Place:
    """A keyed board, somebody in the way to it, and hosts."""

    def __init__(self, key: Path) -> None:
        self.key = key
        self.port, self.near = next(ports), next(ports)
        self.url = f"udp:{GROUP}:{self.port}?interface={LOOPBACK}&key={key}"
        self.board: Board = emulated(self.url)
        self.way = InTheWay((GROUP, self.near), (GROUP, self.port))
        self._hosts: list[Endpoint] = []

    def host(self) -> Endpoint:
        """A host that speaks through whoever is in the way."""
        self._hosts.append(Endpoint(open_link(f"udp:{GROUP}:{self.near}?key={self.key}")))
        return self._hosts[-1]

    def restart(self) -> None:
        """Switch the board off and on."""
        self.board.end()
        self.board = emulated(self.url)

    def attack(self, datagrams: list[bytes]) -> list[bytes]:
        """Send them to the board from the host's address, and each from elsewhere; what it answered but CHALLENGE."""
        before = len(self.way.from_board)
        with attacking_socket() as elsewhere:
            for k, datagram in enumerate(datagrams):
                self.way.inject(datagram)
                elsewhere.sendto(datagram, (GROUP, self.port))
                if k % 50 == 49:
                    time.sleep(0.01)  # no more at once than a socket holds
            answers = drained(elsewhere)
        time.sleep(0.2)
        return [d for d in (*answers, *self.way.from_board[before:]) if d[0] != 0xC2]

    def close(self) -> None:
        """Everybody leaves."""
        for host in self._hosts:
            host.close()
        self.way.close()
        self.board.end()


@pytest.fixture
def place(key: Path) -> Iterator[Place]:
    place = Place(key)
    yield place
    place.close()


# --------------------------------------------------------------------------------------------------- the wire page


def blake(key: bytes, data: bytes, size: int) -> bytes:
    return hashlib.blake2s(data, key=key, digest_size=size).digest()


def test_the_example_of_the_page_by_its_own_words():
    """Written from docs/wire.md, with hashlib alone."""
    host_key = blake(SECRET, b"host" + HOST_NONCE + BOARD_NONCE, 32)
    board_key = blake(SECRET, b"board" + HOST_NONCE + BOARD_NONCE, 32)
    call = b"\xc1" + HOST_NONCE
    challenge = b"\xc2" + HOST_NONCE + BOARD_NONCE + b"\0"
    opening = b"\xc3" + HOST_NONCE + BOARD_NONCE + encode_frame(0x40, 0, 0, b"\1\0\2\0\0\0")
    safe = b"\xc4" + bytes(8) + encode_frame(0x01, 1, 0, b"\1")
    nack = b"\xc4" + bytes(8) + encode_frame(0x32, 0, 0, b"\2\1\0\3")
    assert list(example().values()) == [
        blake(SECRET, b"call", 32),
        blake(SECRET, b"challenge", 32),
        host_key,
        board_key,
        call + blake(blake(SECRET, b"call", 32), call, 16),
        challenge + blake(blake(SECRET, b"challenge", 32), challenge, 16),
        opening + blake(host_key, opening, 16),
        safe + blake(host_key, safe, 16),
        nack + blake(board_key, nack, 16),
    ]


@pytest.mark.parametrize(
    ("key", "data", "size", "expected"),
    [
        (b"", b"abc", 32, "508c5e8c327c14e2e1a72ba34eeb452f37458b209ed63a294d999b4c86675982"),  # RFC 7693, B
        (bytes(range(32)), b"", 32, "48a8997da407876b3d79c0d92325ad3b89cbb754d86ab71aee047ad345fd2c49"),  # blake2s-kat
    ],
)
def test_the_hash_is_the_published_one(key, data, size, expected):
    assert blake(key, data, size).hex() == expected


# ---------------------------------------------------------------------------------- rules 8 to 12, through the sockets


@pytest.mark.slow
def test_a_host_is_heard_through_whoever_is_in_the_way(place):
    host = place.host()
    run_a_little(host)
    assert (host.rx.lost, host.rx.bad, host.link.strangers) == (0, 0, 0)
    assert {datagram[0] for datagram in place.way.from_host} == {0xC1, 0xC3, 0xC4}
    assert {datagram[0] for datagram in place.way.from_board} == {0xC2, 0xC4}


@pytest.mark.long
def test_nothing_recorded_does_anything_again(place, key):
    """In its session; in the next one, of the same host and of another; after a restart; on another board."""
    host = place.host()
    run_a_little(host)
    recorded = list(place.way.from_host)
    assert len(recorded) > 15
    before = status_of(host)
    assert place.attack(recorded) == []
    assert status_of(host) == before
    client.connect(host, PATIENCE_S)
    before = status_of(host)
    assert place.attack(recorded) == []
    assert status_of(host) == before
    host.close()
    again = place.host()
    client.connect(again, PATIENCE_S)
    before = status_of(again)
    assert place.attack(recorded) == []
    assert status_of(again) == before
    again.close()
    assert place.attack(recorded) == []  # nobody has the board
    place.restart()
    assert place.attack(recorded) == []
    third = place.host()
    client.connect(third, PATIENCE_S)
    assert client.read_register(third, "DRIVE_LIMIT", PATIENCE_S) == SPEC.registers["DRIVE_LIMIT"].default
    port = next(ports)
    other = emulated(f"udp:{GROUP}:{port}?key={key}")
    try:
        with attacking_socket() as elsewhere:
            for datagram in (*recorded, *place.way.from_host):
                elsewhere.sendto(datagram, (GROUP, port))
            assert [d for d in drained(elsewhere) if d[0] != 0xC2] == []
    finally:
        other.end()


@pytest.mark.slow
def test_nothing_without_a_key_is_heard(place):
    """SAFE neither (rule 13): before a session, in one, and in one that streams."""
    assert place.attack([plain(message) for message in ATTACKS.values()]) == []
    host = place.host()
    client.connect(host, PATIENCE_S)
    before = status_of(host)

    def attacked() -> list[bytes]:
        return place.attack([plain(message, host.tx.seq + k) for message in ATTACKS.values() for k in range(5)])

    assert attacked() == []
    client.connect(host, PATIENCE_S)  # or the stop of `status_of` latches
    client.write_register(host, "CLOCK_MODE", ClockMode.LOCKSTEP, PATIENCE_S)
    client.arm(host, PATIENCE_S)
    host.poll(0.3)
    assert attacked() == []
    assert client.request(host, Arm(), Status, PATIENCE_S).state == State.ARMED  # only the host stops it
    after = status_of(host)
    assert (after.lost_seq, after.bad_frames) == (before.lost_seq, before.bad_frames)


@pytest.mark.slow
@pytest.mark.realtime
def test_a_host_that_leaves_makes_room_at_once(place):
    for _ in range(3):
        host = place.host()
        begin = time.monotonic()
        client.connect(host, PATIENCE_S)
        assert time.monotonic() - begin < 0.9
        host.close()
    until = time.monotonic() + PATIENCE_S  # the one in the way reads in its own time
    while place.way.from_host[-1][0] != 0xC4 and time.monotonic() < until:
        time.sleep(0.01)
    assert place.way.from_host[-1][0] == 0xC4
    assert len(place.way.from_host[-1]) == 1 + 8 + 16


@pytest.mark.slow
def test_another_key_gets_no_word(place, tmp_path):
    make_key(tmp_path / "other.key")
    for options in (f"?key={tmp_path / 'other.key'}", ""):
        host = Endpoint(open_link(f"udp:{GROUP}:{place.port}{options}"))
        with pytest.raises(LinkError, match=r"no answer to HELLO; is the board on, .* with the same key"):
            client.connect(host, 0.6)
        host.close()


def test_the_counter_ends_and_does_not_wrap():
    out, into = Outgoing(SECRET), Incoming(SECRET)
    first = out.seal(b"first")
    assert first is not None
    assert into.open(first) == b"first"
    out.counter = LAST_COUNTER - 1
    before_last, last = out.seal(b"before"), out.seal(b"last")
    assert out.seal(b"more") is None
    assert into.open(last or b"") == b"last"
    for late in (before_last, last, first):
        assert into.open(late or b"") is None
    assert (into.forged, into.replayed) == (0, 3)


# ------------------------------------------------------------------------------------------------------------ attacks


@pytest.mark.moderate
@pytest.mark.parametrize("target", ["board", "host"])
def test_attacks(target):
    tally = attack.attack_python(30_000, 3, target)
    assert sum(tally.attacks.values()) == 30_000
    assert min(tally.attacks[kind] for kind in attack.KINDS) > 1000
    assert (tally.accepted, tally.unheard) == (0, 0)


@pytest.mark.moderate
def test_attacks_over_sockets():
    tally = attack.attack_sockets(3000, 3)
    assert (tally.accepted, tally.unheard) == (0, 0)


@pytest.mark.moderate
@pytest.mark.parametrize("target", ["board", "host"])
@pytest.mark.parametrize("broken", ["any tag", "any counter", "one session"])
def test_a_broken_receiver_is_found_out(monkeypatch, target, broken):
    if broken == "any tag":
        monkeypatch.setattr(keyed, "compare_digest", lambda *_: True)
    elif broken == "any counter":
        monkeypatch.setattr(keyed.Incoming, "least", property(lambda _: 0, lambda *_: None), raising=False)
    else:
        derived = keyed.derived
        monkeypatch.setattr(keyed, "derived", lambda key, label, *_: derived(key, label))
    assert attack.attack_python(30_000, 3, target).accepted > 0


# ------------------------------------------------------------------------------------------------------ UDP, 1 to 7


@pytest.fixture
def plain_board() -> Iterator[tuple[Board, Endpoint, int]]:
    """A board on loopback without a key, and its host."""
    port = next(ports)
    board = emulated(f"udp:{GROUP}:{port}")
    host = Endpoint(open_link(board.url))
    yield board, host, port
    host.close()
    board.end()


@pytest.mark.slow
@pytest.mark.realtime  # a host that is silent for a second may be replaced
def test_a_stranger_on_loopback_is_not_heard(plain_board):
    """Seen before: anybody in the group armed the board, held full scale, or ended a run with one TIME_SYNC."""
    _, host, port = plain_board
    client.connect(host, PATIENCE_S)
    client.write_register(host, "CLOCK_MODE", ClockMode.LOCKSTEP, PATIENCE_S)
    before = status_of(host)
    with attacking_socket() as stranger:
        for state in (State.SAFE, State.ARMED):
            if state == State.ARMED:
                client.connect(host, PATIENCE_S)
                client.arm(host, PATIENCE_S)
                host.poll(0.3)
            for message in ATTACKS.values():
                for k in range(5):
                    stranger.sendto(plain(message, host.tx.seq + k), (GROUP, port))
            assert drained(stranger) == []
            assert host.poll(0.3) == []
        host.send_drive(1, 2, 1)
        items = []
        until = time.monotonic() + PATIENCE_S
        while not any(isinstance(item.message, Sense) for item in items) and time.monotonic() < until:
            items += host.poll(0.1)
        assert any(isinstance(item.message, Status) and item.message.state == State.RUNNING for item in items)
        assert drained(stranger) == []
    after = status_of(host)
    assert (after.lost_seq, after.bad_frames, after.saturated) == (before.lost_seq, before.bad_frames, before.saturated)


@pytest.mark.slow
@pytest.mark.realtime
def test_another_host_may_begin_a_session_when_the_first_is_gone(plain_board):
    _, host, port = plain_board
    client.connect(host, PATIENCE_S)
    client.write_register(host, "CLOCK_MODE", ClockMode.LOCKSTEP, PATIENCE_S)
    client.arm(host, PATIENCE_S)
    time.sleep(1.1)
    with attacking_socket() as stranger:
        stranger.sendto(plain(Hello(SPEC.protocol, SPEC.hash), 0), (GROUP, port))
        (identity,) = Receiver().feed(b"".join(drained(stranger)))
        assert isinstance(identity.message, Identity)
        stranger.sendto(plain(Safe(SafeReason.HOST_REQUEST), 1), (GROUP, port))
        (status,) = Receiver().feed(b"".join(drained(stranger)))
        assert isinstance(status.message, Status)
        assert status.message.state == State.SAFE
    with pytest.raises(LinkError, match="no answer to SAFE"):
        client.make_safe(host, SafeReason.HOST_REQUEST, 0.5)


@pytest.mark.slow
@pytest.mark.realtime
def test_a_false_board_is_not_heard_and_is_no_sign_of_life(plain_board):
    """IDENTITY, samples, STATUS and TIME_SYNC, from another port of this address and from the port on another one."""
    _, host, port = plain_board
    wire = socket.socket(fileno=socket.dup(host.link.fileno()))
    address = wire.getsockname()
    wire.close()
    assert address[0] == LOOPBACK
    false = Identity(SPEC.protocol, SPEC.hash, 666, 1, 4000.0, 2, 16, 16, 1e-4, 1e-3, 1, 7)
    lies = [plain(false, 0), plain(Status(4, 1, 0, 0, 0, 0, 0, 0, 0, 9), 1), plain(TimeSync(1, 2), 2)]
    for source, source_port in ((LOOPBACK, 0), ("127.0.0.2", port)):
        with attacking_socket(source, source_port) as liar:
            for lie in lies:
                liar.sendto(lie, address)
            assert client.connect(host, PATIENCE_S).unique_id != 666
            before = host.link.strangers
            begin = time.monotonic()
            for _ in range(200):
                liar.sendto(lies[1], address)
            assert host.poll(0.3) == []
            assert time.monotonic() - begin >= 0.3
            assert host.link.strangers == before + 200
            assert not host.exchanges


@pytest.mark.moderate
def test_both_ends_have_their_addresses_to_themselves_on_one_interface(plain_board):
    *_, port = plain_board
    for address in ((GROUP, port), (LOOPBACK, port)):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with pytest.raises(OSError, match="in use") as caught:
                other.bind(address)
            assert caught.value.errno == errno.EADDRINUSE
    with pytest.raises(LinkError, match=f"another program has port {port}; end it, or take another port"):
        open_board_link(f"udp:239.255.42.71:{port}")

    # /proc/net/igmp: an interface, then its groups, as the machine writes them.
    joined, interface = [], ""
    number = f"{int.from_bytes(socket.inet_aton(GROUP), sys.byteorder):08X}"
    for line in Path("/proc/net/igmp").read_text().splitlines()[1:]:
        if not line[0].isspace():
            interface = line.split()[1]
        elif line.split()[0] == number:
            joined.append(interface)
    assert set(joined) == {"lo"}


def test_off_loopback_a_key_is_needed_before_any_socket(monkeypatch):
    monkeypatch.setattr(udp_link.socket, "socket", None)
    for opened in (open_link, open_board_link):
        with pytest.raises(LinkError) as caught:
            opened("udp:239.0.0.1:4242?interface=192.0.2.7")
        said = str(caught.value)
        assert said.startswith(
            "udp:239.0.0.1:4242?interface=192.0.2.7: off this machine anybody could command the board"
        )
        assert "hil key FILE" in said
        assert "\n" not in said


def test_with_a_key_the_interface_is_looked_for(key):
    for opened in (open_link, open_board_link):
        with pytest.raises(LinkError, match=r"no network interface has the address 192\.0\.2\.7; see `ip address`"):
            opened(f"udp:239.0.0.1:4242?interface=192.0.2.7&key={key}")


# --------------------------------------------------------------------------------------------------------- key files


def test_a_key_file_is_its_owners_alone(tmp_path):
    path = tmp_path / "a.key"
    key = make_key(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert read_key(path) == key
    assert path.read_text() == f"gyrohil-key-1 {key.hex()}\n"
    with pytest.raises(LinkError, match="exists already; give another name"):
        make_key(path)
    assert read_key(path) == key
    assert make_key(tmp_path / "b.key") != key
    for mode in (0o640, 0o604, 0o620, 0o660, 0o601):
        path.chmod(mode)
        with pytest.raises(LinkError, match=f"others may use it \\(mode {mode:04o}\\); chmod 600"):
            read_key(path)
    path.chmod(0o400)
    assert read_key(path) == key


@pytest.mark.parametrize(
    "text",
    ["", "gyrohil-key-1 12\n", "ab" * 32, f"gyrohil-key-1 {'ab' * 33}\n", f"gyrohil-key-2 {'ab' * 32}\n", "\xff" * 80],
)
def test_what_is_no_key_is_refused_and_not_shown(tmp_path, text):
    path = tmp_path / "bad.key"
    path.write_text(text, encoding="latin-1")
    path.chmod(0o600)
    with pytest.raises(LinkError, match="expected one line, gyrohil-key-1 and 64 hexadecimal digits") as caught:
        read_key(path)
    assert "ab" * 32 not in str(caught.value)


def test_places_without_a_key_file(tmp_path):
    with pytest.raises(LinkError, match="no such file; make one with `hil key"):
        read_key(tmp_path / "none.key")
    with pytest.raises(LinkError, match=r"key file .*: "):
        read_key(tmp_path)
    with pytest.raises(LinkError, match="give another name"):
        make_key(tmp_path / "no" / "folder.key")


def test_the_verb(tmp_path, capsys):
    path = tmp_path / "a.key"
    assert cli.execute(["key", str(path)]) == 0
    key = read_key(path)
    said = capsys.readouterr()
    assert key.hex() not in said.out + said.err
    assert cli.execute(["key", str(path)]) == 2
    again = capsys.readouterr().err
    assert again.count("\n") == 1
    assert "exists already" in again
    assert cli.execute(["key", str(path), "--c"]) == 0
    words = capsys.readouterr().out.replace(",", " ").split()
    assert bytes(int(word, 16) for word in words if word.startswith("0x")) == key
    assert type_of(Hello) == 0x40  # the page's example has its number written out
