"""An emulated gyro that speaks on a pty of this process."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from device_emulator.gyros import Gyro, _Line, stream
from hil.wire.pty_link import open_pty


@contextmanager
def spoken(gyro: Gyro, baud: int = 0, noise: bytes = b"") -> Iterator[str]:
    """A line on which it speaks, or noise, or nothing."""
    link, over = open_pty(), threading.Event()
    line, sent = _Line(link, baud or gyro.baud), stream(gyro)
    step = max(1, round(gyro.rate_Hz / 100))

    def speak() -> None:
        due = time.monotonic()
        while not over.wait(max(due - time.monotonic(), 0)):
            due += step / gyro.rate_Hz
            pieces = [next(sent) for _ in range(step)]
            line.send(noise or b"".join(one for piece in pieces for one in piece))  # type: ignore[misc]

    thread = threading.Thread(target=speak)
    if gyro.rate_Hz:
        thread.start()
    yield link.path
    over.set()
    if gyro.rate_Hz:
        thread.join()
    link.close()
