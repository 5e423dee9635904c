"""The example board as the process it is, and a host that talks to it."""

import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.framing import seal
from hil.wire.links import open_link
from hil.wire.messages import ClockMode, Message, Nack, NackReason, RegisterWrite
from hil.wire.sense import Sense
from hil.wire.spec import SPEC

PATIENCE_S = 20.0


@contextmanager
def pty_board(built: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The process and the link it announced."""
    process = subprocess.Popen([built / "pty_board", *options], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        ready, _, url = process.stdout.readline().strip().partition(" ")
        assert ready == "ready"
        yield process, url
    finally:
        process.kill()
        process.communicate()


class Host:
    """Says single messages and waits for the answers."""

    def __init__(self, url: str, clock: ClockMode = ClockMode.LOCKSTEP) -> None:
        self.endpoint = Endpoint(open_link(url))
        self.identity = client.connect(self.endpoint, PATIENCE_S)
        client.write_register(self.endpoint, "CLOCK_MODE", clock, PATIENCE_S)

    def set(self, name: str, value: float) -> float:
        return client.write_register(self.endpoint, name, value, PATIENCE_S)

    def hear(self, enough: int = 1) -> list[Message]:
        """The next messages, at least so many."""
        heard: list[Message] = []
        deadline = time.monotonic() + PATIENCE_S
        while len(heard) < enough:
            left = deadline - time.monotonic()
            assert left > 0.0, f"silence after {heard}"
            heard += [item.message for item in self.endpoint.poll(left)]
        return heard

    def say(self, message: Message, answers: int = 1) -> list[Message]:
        """Say something and hear so many answers, no fewer and no more."""
        self.endpoint.send(message)
        heard = self.hear(answers)
        assert len(heard) == answers, heard
        return heard

    def say_raw(self, type_: int, payload: bytes) -> NackReason:
        """Say what no codec would; the reason with which it is refused."""
        tx = self.endpoint.tx
        self.endpoint.link.send(seal(type_.to_bytes(1) + tx.seq.to_bytes(2, "little") + bytes(4) + payload))
        tx.seq += 1
        return refused(self.hear())

    def close(self) -> None:
        self.endpoint.close()


def refused(heard: list[Message]) -> NackReason:
    """The reason of the only answer."""
    (answer,) = heard
    assert isinstance(answer, Nack)
    return NackReason(answer.reason)


def rows(heard: list[Message]) -> list[list[int]]:
    """Rows vx, vy, ux, uy of all SENSE."""
    return [row for message in heard if isinstance(message, Sense) for row in message.codes.tolist()]


def write(name: str, value: float) -> RegisterWrite:
    """A write of a register by its name."""
    return RegisterWrite(SPEC.registers[name].id, value)
