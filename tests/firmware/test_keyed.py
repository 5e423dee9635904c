"""The keyed link of the C library: its hash by published vectors, its datagrams by docs/wire.md, its board attacked."""

import ctypes
import hashlib
import json
import random
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from hil.testing.board_rules.conformance import Board, Conformance
from hil.wire.framing import encode_frame
from hil.wire.key_file import make_key
from hil.wire.keyed import LAST_COUNTER, KeyedHost, Outgoing, derived
from hil.wire.messages import Arm, Hello, Identity, Status
from hil.wire.spec import SPEC
from hil.wire.stream import Received, Receiver, Transmitter
from tests.wire import attacking as attack
from tools.keyed_example import BOARD_NONCE, HOST_NONCE, SECRET, example

from .c_board import CBoard
from .conftest import FIRMWARE, make

HOST, OTHER = 0x7F0000011234, 0x7F0000015678


# ------------------------------------------------------------------------------------------------------------ BLAKE2s


def c_blake2s(library: ctypes.CDLL, key: bytes, data: bytes, size: int) -> bytes:
    held = (ctypes.c_uint32 * 32)()
    out = (ctypes.c_uint8 * 33)(*([0xEE] * 33))
    library.hil_blake2s_init(held, key, ctypes.c_size_t(len(key)), ctypes.c_size_t(size))
    library.hil_blake2s_of(held, data, ctypes.c_size_t(len(data)), out)
    assert bytes(out[size:]) == b"\xee" * (33 - size)
    return bytes(out[:size])


def sequence(size: int, seed: int) -> bytes:
    """RFC 7693, appendix E: selftest_seq."""
    a, b, out = 0xDEAD4BAD * seed & 0xFFFFFFFF, 1, bytearray()
    for _ in range(size):
        a, b = b, (a + b) & 0xFFFFFFFF
        out.append(b >> 24)
    return bytes(out)


def test_the_vectors_of_rfc_7693(library: ctypes.CDLL) -> None:
    """Appendix B, and the self-test of appendix E: a hash over hashes, keyed and not, of six lengths and four sizes."""
    abc = "508c5e8c327c14e2e1a72ba34eeb452f37458b209ed63a294d999b4c86675982"
    assert c_blake2s(library, b"", b"abc", 32).hex() == abc
    told = b""
    for size in (16, 20, 28, 32):
        for length in (0, 3, 64, 65, 255, 1024):
            data = sequence(length, length)
            told += c_blake2s(library, b"", data, size) + c_blake2s(library, sequence(size, size), data, size)
    grand = "6a411f08ce25adcdfb02aba641451cec53c598b24f4fc787fbdc88797f4c1dfe"
    assert c_blake2s(library, b"", told, 32).hex() == grand


def test_every_length_as_hashlib_has_it(library: ctypes.CDLL) -> None:
    draw = random.Random(1)
    for length in (*range(260), 1023, 1024, 8300):
        key, data = draw.randbytes(draw.randint(0, 32)), draw.randbytes(length)
        size = draw.randint(1, 32)
        assert c_blake2s(library, key, data, size) == hashlib.blake2s(data, key=key, digest_size=size).digest()


# ----------------------------------------------------------------------------------------------------------- the link

_NONCE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
_SEND = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_void_p, ctypes.c_size_t)


class _Config(ctypes.Structure):
    """hil_keyed_config."""

    _fields_ = [
        ("key", ctypes.c_uint8 * 32),
        ("datagram", ctypes.c_void_p),
        ("room", ctypes.c_size_t),
        ("nonce", _NONCE),
        ("send", _SEND),
        ("context", ctypes.c_void_p),
    ]


class KeyedCBoard(CBoard):
    """The C board behind its keyed link; `sent` are its datagrams and whom they went to."""

    def __init__(self, library: ctypes.CDLL, room: int = 2000) -> None:
        self.sent: list[tuple[int, bytes]] = []
        self.nonces = [BOARD_NONCE]
        self.now_ns = 77
        self.keyed = (ctypes.c_uint64 * 256)()
        self._memory = (ctypes.c_uint8 * room)()
        self._calls = (_NONCE(self._fresh), _SEND(self._transmit))
        config = _Config((ctypes.c_uint8 * 32)(*SECRET), ctypes.addressof(self._memory), room, *self._calls, None)
        library.hil_keyed_init.restype = ctypes.c_bool
        self.fits: bool = library.hil_keyed_init(self.keyed, ctypes.byref(config))
        super().__init__(library)

    def _link_address(self) -> int:
        return ctypes.addressof(self.keyed)

    def _now(self, _: object) -> int:
        return self.now_ns

    def take(self, datagram: bytes, sender: int = HOST) -> list[tuple[int, bytes]]:
        """Give it a datagram; what it sends on that."""
        self.sent = []
        held = (ctypes.c_uint8 * max(len(datagram), 1)).from_buffer_copy(datagram or b"\0")
        self._c.hil_keyed_receive(
            self.keyed, self._board, ctypes.c_uint64(sender), held, ctypes.c_size_t(len(datagram))
        )
        return self.sent

    def _fresh(self, _: object, nonce: int) -> None:
        ctypes.memmove(nonce, self.nonces[-1], 16)
        self.nonces.append(bytes(byte ^ len(self.nonces) for byte in BOARD_NONCE))

    def _transmit(self, _: object, to: int, data: int, size: int) -> bool:
        self.sent.append((to, ctypes.string_at(data, size)))
        return True


class Talker:
    """A host with the key, by the Python side of the link."""

    def __init__(self, board: KeyedCBoard, sender: int = HOST) -> None:
        self.board, self.sender = board, sender
        self.keyed = KeyedHost(SECRET)
        self.tx, self.rx = Transmitter(), Receiver()
        self.said: list[bytes] = []

    def say(self, message: Any) -> list[Any]:
        return [item.message for item in self.heard(self.keyed.seal(self.tx.encode(message, 0)) or b"")]

    def heard(self, datagram: bytes) -> list[Received]:
        items: list[Received] = []
        self.said.append(datagram)
        for to, answer in self.board.take(datagram, self.sender):
            assert to == self.sender
            heard = self.keyed.heard(answer)
            items += self.heard(heard.reply) if heard.reply else self.rx.feed(heard.frame or b"")
        return items

    def hello(self) -> Identity:
        (identity,) = self.say(Hello(SPEC.protocol, SPEC.hash))
        assert isinstance(identity, Identity)
        return identity


@pytest.fixture
def board(library: ctypes.CDLL) -> KeyedCBoard:
    return KeyedCBoard(library)


def test_the_example_of_the_page(board: KeyedCBoard) -> None:
    """Challenge as printed; HELLO (of another version) answered in frame 0, SAFE in frame 1."""
    page = example()
    assert board.take(page["CALL"]) == [(HOST, page["CHALLENGE"])]
    ((_, identity),) = board.take(page["OPEN with HELLO (protocol 1, spec hash 2)"])
    ((_, status),) = board.take(page["FRAME 0 of the host, SAFE (HOST_REQUEST, sequence 1)"])
    key = derived(SECRET, b"board", HOST_NONCE, BOARD_NONCE)
    for counter, datagram in enumerate((identity, status)):
        body = b"\xc4" + counter.to_bytes(8, "little") + datagram[9:-16]
        assert datagram == body + hashlib.blake2s(body, key=key, digest_size=16).digest()
    first, second = Receiver().feed(identity[9:-16] + status[9:-16])
    assert isinstance(first.message, Identity)
    assert isinstance(second.message, Status)


def test_an_empty_frame_frees_the_board_and_a_second_host_waits_until_then(board: KeyedCBoard) -> None:
    first, second = Talker(board), Talker(board, OTHER)
    first.hello()
    assert second.say(Hello(SPEC.protocol, SPEC.hash)) == []
    assert second.keyed.busy
    leaving = first.keyed.leave()
    assert leaving is not None
    assert board.take(leaving, OTHER) == []  # not from there
    second.say(Hello(SPEC.protocol, SPEC.hash))
    assert second.keyed.busy
    board.take(leaving)
    assert second.hello()
    assert first.say(Arm()) == []
    board.now_ns += 999_999_999
    first.say(Hello(SPEC.protocol, SPEC.hash))
    assert first.keyed.busy
    board.now_ns += 1
    assert first.hello()


def test_the_counter_ends_and_does_not_wrap(board: KeyedCBoard) -> None:
    page = example()
    board.take(page["CALL"])
    board.take(page["OPEN with HELLO (protocol 1, spec hash 2)"])
    out = Outgoing(derived(SECRET, b"host", HOST_NONCE, BOARD_NONCE))
    safe = [encode_frame(1, seq, 0, b"\1") for seq in range(5)]
    first = out.seal(safe[1]) or b""
    assert len(board.take(first)) == 1
    out.counter = LAST_COUNTER - 1
    before_last, last = out.seal(safe[2]) or b"", out.seal(safe[3]) or b""
    assert len(board.take(last)) == 1
    for datagram in (before_last, last, first):
        assert board.take(datagram) == []


def test_memory_for_less_than_an_answer_is_refused(library: ctypes.CDLL) -> None:
    assert not KeyedCBoard(library, room=100).fits


# ------------------------------------------------------------------------------------------------------------ attacks


@pytest.mark.long
def test_attacks_under_the_sanitizers(tmp_path: Path) -> None:
    program = tmp_path / "attack"
    options = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", f"-I{FIRMWARE / 'src'}"]
    sources = [*map(str, (FIRMWARE / "src").glob("*.c")), str(FIRMWARE / "fuzz" / "attack.c")]
    subprocess.run(["cc", "-O1", *options, "-o", str(program), *sources], check=True)
    tally = attack.attack_c(program, 300_000, 2)
    assert tally.accepted == tally.unheard == 0
    assert sum(tally.attacks.values()) == 300_000
    assert min(tally.attacks.values()) > 10_000
    assert tally.sessions > 20


@pytest.mark.beyond(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "broken", "kinds"),
    [
        ("return difference == 0u;", "return true;", {"invented", "bits flipped", "respliced"}),
        ("if (counter < k->least ||", "if (counter + 1u < k->least ||", {"replayed"}),
        ("if (counter < k->least ||", "if (", {"replayed", "reordered"}),
        (" || memcmp(nonces + HIL_NONCE_SIZE, k->nonce, HIL_NONCE_SIZE) != 0", "", {"earlier session"}),
        ('derive(k, "host", nonces, &incoming)', 'derive(k, "host", NULL, &incoming)', set()),
        ("else if (from_peer)", "else if (k->open)", {"from elsewhere"}),
        ("k < HIL_TAG_SIZE; k++)\n        difference", "k < 1u; k++)\n        difference", {"invented"}),
    ],
)
def test_a_broken_link_is_found_out(tmp_path: Path, line: str, broken: str, kinds: set[str]) -> None:
    """No tag; a counter that may stand still; none at all; nonces that work twice; no nonce in the key; any sender; one
    byte of the tag."""
    shutil.copytree(FIRMWARE / "src", tmp_path / "src")
    source = tmp_path / "src" / "hil_keyed.c"
    assert line in source.read_text()
    source.write_text(source.read_text().replace(line, broken))
    sources = [*map(str, (tmp_path / "src").glob("*.c")), str(FIRMWARE / "fuzz" / "attack.c")]
    subprocess.run(["cc", "-O1", f"-I{tmp_path / 'src'}", "-o", str(tmp_path / "attack"), *sources], check=True)
    done = subprocess.run([tmp_path / "attack", "100000"], capture_output=True, text=True, check=False)
    told = json.loads(done.stdout)
    assert done.returncode == 1
    assert kinds <= {kind for kind, count in told["taken"].items() if count}


@pytest.mark.slow
def test_a_million_attacks(tmp_path: Path) -> None:
    tally = attack.attack_c(make(tmp_path, "attack") / "attack", 1_000_000, 7)
    assert (tally.accepted, tally.unheard) == (0, 0)


@pytest.mark.slow
@pytest.mark.realtime
class TestCBoardOnUdp(Conformance):
    """The example board holds what every board holds."""

    @pytest.fixture(scope="class", autouse=True)
    @classmethod
    def _program(cls, built: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
        key = tmp_path_factory.mktemp("key") / "board.key"
        make_key(key)
        cls.command = [str(built / "udp_board"), "239.255.42.68:42680", str(key)]

    @classmethod
    def start(cls) -> Board:
        return Board(cls.command)


def test_the_example_board_refuses_a_key_that_others_can_read(built: Path, tmp_path: Path) -> None:
    key = tmp_path / "board.key"
    make_key(key)
    key.chmod(0o644)
    command = [built / "udp_board", "239.255.42.68:42682", str(key)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "udp_board: cannot start: Permission denied\n"
