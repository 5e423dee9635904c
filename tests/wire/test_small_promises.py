"""Smaller promises of the wire: claims, stamps, frames in one step, what is closed (docs/wire.md)."""

import os
import socket
import struct
import time
import tomllib
from pathlib import Path

import pytest

from hil.wire import client, spec
from hil.wire.can_format import CanFormat
from hil.wire.claim import Claim
from hil.wire.codec import pack, type_of
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import BOARD, HOST, FrameFormat
from hil.wire.links import open_board_link, open_link
from hil.wire.messages import DriveForce, RegisterRead, RegisterValue, Safe
from hil.wire.pty_link import open_pty
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC
from hil.wire.stamp import stamp_ns

UDP = "udp:239.255.42.79:48181"


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_name_is_held_by_one_and_free_when_released() -> None:
    name = f"test-{os.getpid()}"
    first = Claim(name, "can:x", "end the other")
    before = descriptors()
    for _ in range(3):
        with pytest.raises(LinkError, match="can:x: end the other"):
            Claim(name, "can:x", "end the other")
    assert descriptors() == before  # who is refused leaves nothing open
    first.release()
    first.release()
    Claim(name, "can:x", "end the other").release()


@pytest.mark.parametrize("seconds", [0.25, 1.75])
def test_a_stamp_is_an_age_taken_off_the_monotonic_clock(seconds: float) -> None:
    arrived = time.time_ns() - round(seconds * 1e9)
    data = struct.pack("@ll", *divmod(arrived, 1_000_000_000))
    found = stamp_ns([(socket.SOL_SOCKET, 35, data)])
    assert time.monotonic_ns() - found == pytest.approx(seconds * 1e9, abs=5e7)
    assert stamp_ns([]) == 0
    assert stamp_ns([(socket.SOL_SOCKET, 1, data), (socket.SOL_SOCKET, 35, data[:8])]) == 0


def test_a_link_that_has_heard_nothing_has_no_stamp_and_lost_nothing() -> None:
    board, host = open_board_link(UDP), open_link(UDP)
    try:
        assert (host.arrived_ns, board.arrived_ns) == (0, 0)
        assert (host.dropped_bytes, board.dropped_bytes) == (0, 0)
    finally:
        host.close()
        board.close()


def test_a_closed_descriptor_is_nobodys() -> None:
    """Closed twice it does not close another that took its number."""
    link = open_pty()
    link.close()
    assert link.fileno() == -1
    other = os.open(os.devnull, os.O_RDONLY)
    try:
        link.close()
        os.fstat(other)
        os.fstat(0)
    finally:
        os.close(other)
    with pytest.raises(LinkClosed, match="closed"):
        link.offer(b"\0")


@pytest.mark.parametrize("tick", [0, 5, 2**32 + 7])
def test_a_drive_in_one_step_is_the_frame_of_the_codec(tick: int) -> None:
    type_, payload = type_of(DriveForce), pack(DriveForce(-3, 400, (tick + 3) & 0xFFFFFFFF))
    quick = SERIAL.encode_drive(9, tick, -3, 400, tick + 3)
    assert quick == SERIAL.encode(type_, 9, tick & 0xFFFFFFFF, payload)[0]


@pytest.mark.parametrize("ends", [(SERIAL, SERIAL), (CanFormat(3, HOST), CanFormat(3, BOARD))], ids=["serial", "CAN"])
def test_a_drive_or_a_row_that_is_expected_is_read_in_one_step_and_counted(ends: tuple[FrameFormat, ...]) -> None:
    host, board = ends
    drive, row = host.encode_drive(9, 5, -3, 400, 8), board.encode_row(9, 5, 1, -2, 3, -4, 0, 2)
    of_drives, of_rows = board.decoder(), host.decoder()
    for another in (8, 10, None):
        assert of_drives.drive(drive, another) is None
        assert of_rows.row(row, another) is None
    assert of_drives.row(drive, 9) is None
    assert of_rows.drive(row, 9) is None
    counted = [(one.frames, one.bytes) for one in (of_drives, of_rows)]
    assert counted == [(0, 0), (0, 0)]
    assert of_drives.drive(drive, 9) == (5, -3, 400, 8)
    assert of_rows.row(row, 9) == (5, 1, -2, 3, -4, 0)
    counted = [(one.frames, one.bytes) for one in (of_drives, of_rows)]
    assert counted == [(1, len(drive)), (1, len(row))]


def test_what_is_no_drive_is_not_read_as_one() -> None:
    decoder = SERIAL.decoder()
    assert decoder.drive(SERIAL.encode(type_of(Safe), type_of(DriveForce), 5, bytes(12))[0], 9) is None
    assert decoder.drive(SERIAL.encode(type_of(Safe), 9, 5, bytes(1))[0], 9) is None


def test_numbers_that_add_up_are_flags_and_others_are_not() -> None:
    flags = {name for name, one in SPEC.enums.items() if one.flags}
    raw = tomllib.loads((Path(spec.__file__).parent / "spec.toml").read_text(encoding="utf-8"))
    parts = (raw, *raw["optional"].values())
    assert flags == {name for part in parts for name in part.get("flags", ())}
    assert set(SPEC.enums) - flags == {name for part in parts for name in part.get("enums", ())}


def test_a_register_is_waited_for_two_seconds_where_nobody_says(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def request(endpoint, message, answer, timeout_s, wanted, what):
        assert isinstance(message, RegisterRead)
        asked.append(timeout_s)
        return RegisterValue(message.register, 1.5)

    monkeypatch.setattr(client, "request", request)
    name = next(iter(SPEC.registers))
    assert client.read_register(None, name) == 1.5
    assert client.read_register(None, name, 0.3) == 1.5
    assert asked == [2.0, 0.3]


def test_a_frame_on_a_stream_takes_one_number_and_is_sealed() -> None:
    data, spent = SERIAL.encode(type_of(Safe), 9, 5, b"\1")
    assert (spent, SERIAL.sealed) == (1, True)
    assert SERIAL.kind(data) == type_of(Safe)
    assert SERIAL.kind(data[:-3] + b"\0") is None


def test_a_stretch_of_a_stream_is_cut_into_its_frames_and_the_rest() -> None:
    one, two = (SERIAL.encode(type_of(Safe), seq, 5, b"\1")[0] for seq in (1, 2))
    assert (one[0], one[-1]) == (0, 0)
    assert SERIAL.cut(one + two + b"\0rest") == ([one, two], b"rest")
    assert SERIAL.cut(one[1:] + b"\0\0" + two) == ([one, two], b"")
    assert SERIAL.cut(b"rest") == ([], b"rest")


@pytest.mark.parametrize("width", [2, 3])
def test_a_row_of_either_width_is_read_in_one_step_and_junk_is_not(width: int) -> None:
    data = SERIAL.encode_row(9, 2**32 + 5, 1, -2, 3, -4, 5, width)
    decoder = SERIAL.decoder()
    assert decoder.row(data, 9) == (5, 1, -2, 3, -4, 5)
    assert decoder.row(data, 9) == (5, 1, -2, 3, -4, 5)
    assert (decoder.frames, decoder.bytes) == (2, 2 * len(data))
    assert decoder.row(SERIAL.encode(type_of(Safe), 9, 5, bytes(1))[0], 9) is None
    assert decoder.row(b"\0junk\0", 9) is None
    assert decoder.drive(b"\0junk\0", 9) is None


def test_a_refusal_is_told_in_its_own_words() -> None:
    refusal = client.Refused("the board refused ARM: not ready", 3)
    assert str(refusal) == "the board refused ARM: not ready"
    assert refusal.reason == 3
