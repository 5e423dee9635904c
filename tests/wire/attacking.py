"""Attack datagrams against the keyed link: the C board (`firmware/fuzz/attack.c`), Python board and host.

Between attacks the holder of the key talks, so that there is always something fresh to record: all of that must be
taken, and nothing else.  The attacker has every datagram, of this session and of those before, in both directions, also
such as the receiver has not seen; what it lacks is the key.  Over UDP a third come from the very address of the host.
"""

import json
import random
import socket
import subprocess
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from hil.wire.framing import encode_frame
from hil.wire.key_file import make_key, read_key
from hil.wire.keyed import CALL, CHALLENGE, FRAME, NONCE_SIZE, OPEN, TAG_SIZE, KeyedBoard, KeyedHost
from hil.wire.link_name import LOOPBACK
from hil.wire.links import open_board_link
from hil.wire.messages import Arm, DriveForce, Hello, Message, Safe, Status, TimeSync
from hil.wire.stream import Transmitter
from hil.wire.udp_link import UdpBoard

SESSION = 4000  # attacks, about
KINDS = (
    "replayed",
    "earlier session",
    "reordered",
    "bits flipped",
    "cut",
    "counted up",
    "invented",
    "noise",
    "unkeyed",
    "reflected",
    "respliced",
)
GROUP, PORT = "239.255.42.66", 42660


@dataclass
class Tally:
    """Attacks by kind; what of them was taken, and what of the holder's was not."""

    attacks: Counter[str] = field(default_factory=Counter)
    accepted: int = 0
    unheard: int = 0
    sessions: int = 0


class Attacker:
    """Everything that can be made of recordings without the key."""

    def __init__(self, seed: int) -> None:
        self._draw = random.Random(seed)
        self.earlier: list[bytes] = []  # of sessions before, the receiver's direction
        self.seen: list[bytes] = []  # of this one, taken
        self.late: list[bytes] = []  # of this one, overtaken before they came
        self.reflected: list[bytes] = []  # the other direction
        self.next = b""  # what the receiver has not seen
        self.messages: list[Message] = [Arm(), DriveForce(32767, 32767, 9), Safe(1), TimeSync(1, 0), Hello(1, 2)]

    def new_session(self) -> None:
        """What was recorded is of an earlier one."""
        self.earlier = (self.earlier + self.seen + self.late)[-1000:]
        self.seen, self.late = [], []

    def attack(self) -> tuple[str, bytes]:
        """One datagram, and what is wrong with it."""
        draw = self._draw
        kind = draw.choice(KINDS)
        source = {"earlier session": self.earlier, "reordered": self.late, "reflected": self.reflected}.get(kind)
        old = draw.choice((self.seen if source is None else source) or [b"\xc4" + bytes(40)])
        match kind:
            case "bits flipped":
                damaged = bytearray(draw.choice((old, self.next)))
                for bit in draw.sample(range(8 * len(damaged)), draw.randint(1, 4)):
                    damaged[bit >> 3] ^= 1 << (bit & 7)
                return kind, bytes(damaged)
            case "cut":
                size = draw.randrange(len(self.next))
                return kind, draw.choice((self.next[:size], self.next + draw.randbytes(1 + size % 20)))
            case "counted up":
                return kind, b"\xc4" + draw.randrange(1 << 40).to_bytes(8, "little") + old[9:]
            case "invented":
                frame = encode_frame(draw.choice((0x01, 0x02, 0x10, 0x31, 0x20, 0x41)), 3, 0, draw.randbytes(12))
                head = bytes((draw.choice((OPEN, CHALLENGE)),)) + self.next[1 : 1 + 2 * NONCE_SIZE]
                counted = bytes((FRAME,)) + draw.randrange(1 << 40).to_bytes(8, "little")
                return kind, draw.choice((head, counted)) + frame + draw.randbytes(TAG_SIZE)
            case "noise":
                return kind, bytes((draw.choice((0, CALL, CHALLENGE, OPEN, FRAME)),)) + draw.randbytes(
                    draw.randrange(80)
                )
            case "unkeyed":
                return kind, Transmitter().encode(draw.choice(self.messages), 0)
            case "respliced":
                return kind, old[:-TAG_SIZE] + self.next[-TAG_SIZE:]
        return kind, old


class Parties:
    """A host and a board with the same key; the attacks go to one of them."""

    def __init__(self, seed: int) -> None:
        self.key = random.Random(seed).randbytes(32)
        self.host, self.board = KeyedHost(self.key), KeyedBoard(self.key)
        self._tx = Transmitter()

    def begin(self) -> tuple[list[bytes], list[bytes]]:
        """A new session; what the host said for it, and the board."""
        call = self.host.seal(self._tx.encode(Hello(1, 2), 0)) or b""
        challenge = self.board.heard(call, from_peer=True, taken=False).reply
        opening = self.host.heard(challenge).reply
        if not self.board.heard(opening, from_peer=True, taken=False).opened:
            raise RuntimeError("no session")
        return [call, opening], [challenge]

    def restart_board(self) -> None:
        """Switch the board off and on."""
        self.board = KeyedBoard(self.key)

    def says(self, party: KeyedHost | KeyedBoard) -> bytes:
        """The next datagram of one of them."""
        message: Message = DriveForce(1, 2, 3) if party is self.host else Status(3, 0, 0, 0, 0, 0, 0, 0, 0, 5)
        return party.seal(self._tx.encode(message, 7)) or b""


def attack_python(amount: int, seed: int, target: str) -> Tally:
    """Attacks on the Python board or host ("board", "host"), without sockets."""
    attacker, parties, tally = Attacker(seed), Parties(seed), Tally()
    draw = random.Random(seed + 1)
    done = 0

    def take(datagram: bytes) -> bool:
        if target == "host":
            heard = parties.host.heard(datagram)
        else:
            heard = parties.board.heard(datagram, from_peer=True, taken=False)
        is_call = target == "board" and datagram[:1] == bytes((CALL,))
        return heard.frame is not None or heard.opened or (bool(heard.reply) and not is_call)

    while done < amount:
        if tally.sessions % 5 == 4:
            parties.restart_board()
        attacker.new_session()
        opening, answers = parties.begin()
        ours, theirs = (opening, answers) if target == "board" else (answers, opening)
        attacker.seen += ours
        attacker.reflected = theirs
        tally.sessions += 1
        speaker = parties.host if target == "board" else parties.board
        listener = parties.board if target == "board" else parties.host
        for _ in range(SESSION // 20):
            attacker.next = parties.says(speaker)
            attacker.reflected.append(parties.says(listener))
            if draw.random() < 0.1:  # overtaken
                attacker.late.append(attacker.next)
                attacker.next = parties.says(speaker)
                tally.unheard += not take(attacker.next)
                attacker.seen.append(attacker.next)
                continue
            for _ in range(min(20, amount - done)):
                kind, datagram = attacker.attack()
                tally.accepted += take(datagram)
                tally.attacks[kind] += 1
                done += 1
            tally.unheard += not take(attacker.next)
            attacker.seen.append(attacker.next)
    return tally


def attacking(source: str = LOOPBACK) -> socket.socket:
    """A socket on the loopback interface."""
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(source))
    wire.bind((source, 0))
    wire.setblocking(False)
    return wire


def attack_sockets(amount: int, seed: int) -> Tally:
    """Attacks on the Python board over UDP on 127.0.0.1, from its host's own address and from another one."""
    tally, attacker, tx = Tally(), Attacker(seed), Transmitter()
    with tempfile.TemporaryDirectory() as folder, attacking() as same, attacking() as other:
        make_key(Path(folder, "attack.key"))
        host = KeyedHost(read_key(Path(folder, "attack.key")))
        board = open_board_link(f"udp:{GROUP}:{PORT}?key={folder}/attack.key")
        assert isinstance(board, UdpBoard)

        def say(datagram: bytes, wire: socket.socket = same) -> bytes:
            wire.sendto(datagram, (GROUP, PORT))  # on loopback it is there when this returns
            return board.receive(0.0)

        try:
            while sum(tally.attacks.values()) < amount:
                attacker.new_session()
                hello = tx.encode(Hello(1, 2), 0)
                call = host.seal(hello) or b""
                say(call)
                challenge = same.recv(200)
                opening = host.heard(challenge).reply
                tally.unheard += say(opening) != hello
                tally.sessions += 1
                attacker.seen, attacker.reflected = [opening], [challenge]
                for _ in range(SESSION // 20):
                    frame = tx.encode(DriveForce(1, 2, 3), 7)
                    attacker.next = host.seal(frame) or b""
                    refused = board.strangers
                    for k in range(20):
                        kind, datagram = attacker.attack()
                        tally.accepted += say(datagram, other if k % 3 else same) != b""
                        tally.attacks[kind] += 1
                    tally.accepted += board.strangers != refused + 20  # each was counted: none got lost on the way
                    tally.unheard += say(attacker.next) != frame
                    attacker.seen.append(attacker.next)
        finally:
            board.close()
    return tally


def attack_c(program: Path, amount: int, seed: int) -> Tally:
    """Run the C attacker. Its exit code is 1 when something was taken; then that is in the tally."""
    done = subprocess.run([program, str(amount), str(seed)], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{program} ended with {done.returncode}: {done.stderr[-300:]}")
    told = json.loads(done.stdout)
    return Tally(Counter(told["attacks"]), told["accepted"], told["unheard"], told["sessions"])
