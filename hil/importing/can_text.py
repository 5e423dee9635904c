"""CAN frames written as text: candump's log (`-l`, `-L`) and its screen with times (`-ta`), canboat's raw lines, in
which a message of NMEA 2000 may stand whole, and those of Yacht Devices' gateways, with the time of day.
"""

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.errors import InputError

if TYPE_CHECKING:
    import can

_LOG = re.compile(r"\s*\((\d+\.\d+)\)\s+\S+\s+([0-9A-Fa-f]{3,8})#(#[0-9A-Fa-f])?((?:[0-9A-Fa-f]{2}\.?)*)")
_SCREEN = re.compile(
    r"\s*(?:\(([^)]*)\)\s+)?\w+\s+(?:[TR]X [-BE ]+\s+)?([0-9A-Fa-f]{3,8})\s+\[(\d+)\]\s+((?:[0-9A-Fa-f]{2}\s*)*)"
)
_CANBOAT = re.compile(
    r"(\d{4}-\d\d-\d\d)[T-](\d\d:\d\d:\d\d[.\d]*)Z?,(\d+),(\d+),(\d+),(\d+),\d+((?:,[0-9A-Fa-f]{2})+)"
)
_GATEWAY = re.compile(r"(\d\d):(\d\d):(\d\d\.\d+) [RT] ([0-9A-Fa-f]{8})((?: [0-9A-Fa-f]{2})+)")
_STANDARD = 3  # hexadecimal digits of an identifier of 11 bits
_TRIED = 200  # lines that say whether it is such a text
_UNTIMED = "times are missing; record with candump -l, or with -ta on the screen"


def text_frames(path: Path) -> "Iterator[can.Message]":
    """The frames of a text; lines that are none, such as comments, are left out. Raises InputError where none is, and
    where they have no times.
    """
    found = 0
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            frame = _frame(line, f"{path}: line {number}")
            if frame is not None:
                found += 1
                yield frame
            elif not found and number > _TRIED:
                break
    if not found:
        raise InputError(f"{path}: no frame in it that candump, canboat or a logger writes; give a log that holds some")


def is_text_of_frames(start: str) -> bool:
    """Whether the beginning of a text has such a line."""
    lines = start.splitlines()
    return any(
        _LOG.match(line) or _CANBOAT.match(line) or _GATEWAY.match(line) or (_SCREEN.match(line) and "[" in line)
        for line in lines
    )


def _frame(line: str, where: str) -> "can.Message | None":
    if (log := _LOG.match(line)) is not None:
        time, identifier, fd, data = log.groups()
        return _message(float(time), identifier, data.replace(".", ""), is_fd=fd is not None)
    if (raw := _CANBOAT.match(line)) is not None:
        day, time, priority, pgn, source, target, data = raw.groups()
        number = int(pgn) | (int(target) & 0xFF if int(pgn) >> 8 & 0xFF < 240 else 0)
        payload = bytes.fromhex(data.replace(",", ""))
        return _made(
            timestamp=datetime.fromisoformat(f"{day}T{time}").replace(tzinfo=UTC).timestamp(),
            arbitration_id=(int(priority) & 7) << 26 | number << 8 | int(source) & 0xFF, data=payload,
            is_fd=len(payload) > 8,
        )  # fmt: skip
    if (gateway := _GATEWAY.match(line)) is not None:
        hours, minutes, seconds, identifier, data = gateway.groups()
        return _message(3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds), identifier, data)
    if (screen := _SCREEN.match(line)) is not None:
        time, identifier, length, data = screen.groups()
        if int(length) == len(bytes.fromhex(data)):
            try:
                return _message(float(time), identifier, data)
            except (TypeError, ValueError):
                raise InputError(f"{where}: {_UNTIMED}") from None
    return None


def _message(stamp: float, identifier: str, data: str, *, is_fd: bool = False) -> "can.Message":
    is_extended = len(identifier) > _STANDARD
    return _made(timestamp=stamp, arbitration_id=int(identifier, 16), is_extended_id=is_extended,
                 data=bytes.fromhex(data), is_fd=is_fd)  # fmt: skip


def _made(**said: Any) -> "can.Message":
    from can import Message  # with its readers of logs, which take long to load

    return Message(**said, check=False)
