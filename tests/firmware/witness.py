"""A second pty between a host and a board on one: every byte goes through, both ways, and every message is kept.

The cable may be wrong: it changes what the board says.
"""

import select
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hil.wire.errors import LinkError
from hil.wire.fd_link import FdLink
from hil.wire.links import open_link
from hil.wire.messages import Arm, DriveForce, Message, Safe, State, Status
from hil.wire.pty_link import open_pty
from hil.wire.sense import Sense
from hil.wire.stream import Receiver, Transmitter

Changed = Callable[[Message], Message]


class Witness:
    """Between the board at `far` and a host that opens `url`; a hang-up of one end is passed on to the other.

    heard: whether the host said it, and what, in order.
    """

    def __init__(self, far: str, changed: Changed | None = None) -> None:
        self._far_url, self._changed = far, changed
        self._near = open_pty()
        self._far: FdLink | None = None  # while there is no host
        self.url = self._near.url
        self.heard: list[tuple[bool, Message]] = []
        self._receivers = {True: Receiver(), False: Receiver()}
        self._tx = Transmitter()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def end(self) -> None:
        """Let go of both ends."""
        self._stop.set()
        self._thread.join()

    def _opened(self) -> FdLink:
        link = open_link(self._far_url)
        assert isinstance(link, FdLink)
        return link

    def _serve(self) -> None:
        try:
            while not self._stop.is_set():
                self._pass_on()
        except LinkError:  # the board is gone
            pass
        finally:
            self._near.close()
            if self._far is not None:
                self._far.close()

    def _pass_on(self) -> None:
        there = select.select([link for link in (self._near, self._far) if link is not None], [], [], 0.05)[0]
        if self._far in there and self._far is not None:
            self._to_host(self._far.receive(0.0))
        if self._near in there:
            try:
                data = self._near.receive(0.0)
            except LinkError:
                self._hung_up()
                return
            self.heard += [(True, item.message) for item in self._receivers[True].feed(data)]
            self._far = self._opened() if self._far is None else self._far
            self._far.send(data)

    def _to_host(self, data: bytes) -> None:
        items = self._receivers[False].feed(data)
        self.heard += [(False, item.message) for item in items]
        if self._changed is not None:
            data = b"".join(self._tx.encode(self._changed(item.message), item.tick) for item in items)
        try:
            self._near.send(data)
        except LinkError:
            self._hung_up()

    def _hung_up(self) -> None:
        """The board hears it, and may have another host."""
        if self._far is not None:
            self._far.close()
            self._far = None
        self._near.await_host()

    def wait_until_driven(self, time_armed: int, patience_s: float = 60.0) -> None:
        """Until the board shows a drive, having been armed for the so-manieth time."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            heard = list(self.heard)
            arms = [k for k, (_, message) in enumerate(heard) if isinstance(message, Arm)]
            if len(arms) == time_armed and any(drive_of(message) for _, message in heard[arms[-1] :]):
                return
            time.sleep(0.05)
        raise AssertionError(f"no drive: {len(self.heard)} messages")

    def wait_for_stop(self, patience_s: float = 60.0) -> None:
        """Until the board says that it is SAFE."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            for _, message in reversed(list(self.heard)):
                if isinstance(message, Status):
                    if message.state == State.SAFE:
                        return
                    break
            time.sleep(0.05)
        raise AssertionError("the board is not SAFE")

    def largest(self) -> int:
        """Largest drive code that was asked for or applied."""
        return max(drive_of(message) for _, message in self.heard)

    def stops(self) -> list[int]:
        """Why the board was SAFE by its own word, for each time that it was armed.

        Raises AssertionError where it was left armed, or asked to drive when it was not.
        """
        armed, found = False, []
        for by_host, message in self.heard:
            if isinstance(message, Arm):
                armed = True
            elif armed and isinstance(message, Status) and message.state == State.SAFE:
                armed = False
                found.append(message.reason)
            elif not armed and by_host:
                assert drive_of(message) == 0
        assert not armed
        return found

    def told_to_stop(self) -> list[int]:
        """Reasons of the host's SAFE."""
        return [message.reason for by_host, message in self.heard if by_host and isinstance(message, Safe)]


def drive_of(message: Message) -> int:
    """Largest code of a drive that is asked for, or was applied."""
    if isinstance(message, DriveForce):
        return max(abs(message.ux), abs(message.uy))
    return int(abs(message.codes[:, 2:4]).max()) if isinstance(message, Sense) and len(message.codes) else 0


@contextmanager
def witnessed(far: str, changed: Changed | None = None) -> Iterator[Witness]:
    """One, for the length of the block."""
    witness = Witness(far, changed)
    try:
        yield witness
    finally:
        witness.end()
