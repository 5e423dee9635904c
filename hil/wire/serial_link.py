"""A serial port, real or the host's end of a pty. pyserial opens and configures it; afterwards only its
descriptor is used, because `Serial.read` costs several times as much as select and os.read."""

import errno
import os
import termios
import time
from contextlib import suppress

import serial
from serial.tools import list_ports

from hil.wire.errors import LinkError
from hil.wire.fd_link import FdLink
from hil.wire.link_name import DEFAULT_BAUD

# How long another program's hold of a port is waited for: some probe a port as soon as it is plugged in, and a process
# that is being started holds its parent's ports for a moment.
PASSING_S = 1.0
_RETRY_S = 0.02
_IN_USE = (errno.EAGAIN, errno.EBUSY)


class SerialLink(FdLink):
    def __init__(self, port: serial.Serial, path: str) -> None:
        super().__init__(port.fileno(), f"serial:{path}")
        self._port = port

    def close(self) -> None:
        self._fd = -1
        self._port.close()


def open_serial(path: str, baud: int = DEFAULT_BAUD) -> SerialLink:
    """Open a port raw, 8N1, without flow control, exclusively, and with low latency where its driver can.

    Raises:
        LinkError: no such port, in use for longer than a second, no permission, or not a serial port.
    """
    patience = time.monotonic() + PASSING_S
    while True:
        try:
            # An inter-byte timeout of 0 sets VMIN = 1: reading nothing then means hang-up, and only that.
            port = serial.Serial(path, baud, timeout=0, inter_byte_timeout=0, exclusive=True)
            break
        except (OSError, ValueError, OverflowError, termios.error) as error:
            if _number(error) not in _IN_USE or time.monotonic() > patience:
                raise LinkError(f"serial:{path}: {_remedy(path, error)}") from None
        time.sleep(_RETRY_S)
    with suppress(OSError, ValueError):  # a pty, and many a driver, has no such setting
        port.set_low_latency_mode(True)
    return SerialLink(port, path)


def _number(error: Exception) -> int | None:
    """errno of an error, which that of termios has in its arguments."""
    found = error.args[0] if isinstance(error, termios.error) and error.args else getattr(error, "errno", None)
    return found if isinstance(found, int) else None


def _remedy(path: str, error: Exception) -> str:
    number = _number(error)
    if number in _IN_USE:
        return "the port is in use by another program; close it there, or name another port"
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        found = ", ".join(sorted(port.device for port in list_ports.comports())) or "none"
        return f"no such port; connect the board or name another port (found: {found})"
    if number == errno.EIO:
        return "its other end is gone; connect the board again"
    if number == errno.EACCES:
        return "no permission; add yourself to the group that owns the port (often dialout) and log in again"
    if not _is_terminal(path):
        return "not a serial port; name a terminal device such as /dev/ttyUSB0"
    return f"{error}; try another baud rate"


def _is_terminal(path: str) -> bool:
    with suppress(OSError):
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            return os.isatty(fd)
        finally:
            os.close(fd)
    return False
