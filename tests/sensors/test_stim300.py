"""The STIM300's rate-only datagram: golden ones, a damaged stream, and the emulated source against the decoder."""

import math
from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st

from device_emulator.gyros import GYROS, Motion, crc32, stim, stream
from hil.sensors.layouts import CHECKS
from tests.sensors.golden import SIZE, Stim300, golden, remainder

# Written down once, so that code and hand calculation cannot drift together.
WIRE = [
    "90000000000000000000000000002E5DFC73",
    "90004000FFC00000012400E101FA3B423886",
    "907FFFFF80000064000051FFFFFF9199B668",
]


LONGEST = 63  # bytes of a datagram: what looks like the beginning of one is waited for that long


def sent(count: int) -> list[bytes]:
    """The first datagrams of the emulated sensor."""
    return [bytes(one) for datagram in islice(stream(GYROS["stim300"]), count) for one in datagram]  # type: ignore[arg-type]


def test_the_checksum_is_the_published_one() -> None:
    """CRC-32/MPEG-2, whose check value of "123456789" is 0376E6E7."""
    assert remainder(b"123456789") == 0x0376E6E7
    assert remainder(b"1234567890abcd\0\0") == crc32(b"1234567890abcd")


@pytest.mark.moderate
@given(st.binary(min_size=14, max_size=14))
def test_three_ways_to_the_same_checksum(body: bytes) -> None:
    assert (made := remainder(body + b"\0\0")) == crc32(body)
    assert CHECKS["crc32"].left(body + made.to_bytes(4, "big")) == 0
    assert CHECKS["crc32"].left(body + (made ^ 1).to_bytes(4, "big")) != 0


@pytest.mark.parametrize("chunk", [1, 7, 18, 4096])
def test_golden_datagrams(chunk: int) -> None:
    wire = b"".join(datagram for datagram, *_ in golden())
    assert len(wire) == 3 * SIZE
    decoder = Stim300()
    samples = [s for at in range(0, len(wire), chunk) for s in decoder.feed(wire[at : at + chunk])]
    assert [(s.counter, s.codes, s.status, s.latency_us) for s in samples] == [tuple(m) for _, *m in golden()]
    assert (decoder.crc_errors, decoder.skipped) == (0, 0)


def test_golden_datagrams_as_written_down() -> None:
    assert [datagram.hex().upper() for datagram, *_ in golden()] == WIRE


def test_the_emulated_sensor_sends_golden_datagrams() -> None:
    datagram, counter, codes, status, _ = golden()[1]  # the one with the latency that it has
    x, y, z = (code / 2**14 for code in codes)
    assert stim(Motion(0, counter / 2000.0, (x, y, z), status=status)) == datagram


def test_one_step_is_two_to_the_minus_14_degrees_per_second() -> None:
    assert 400.0 / math.degrees(Stim300().channels[0].scale) == 6553600
    assert [column.name for column in Stim300().channels] == ["rate_x_code", "rate_y_code", "rate_z_code"]


def test_status_in_words() -> None:
    said = Stim300().complaints
    assert said(0) == []
    assert said(0x40) == ["starting up"]
    assert said(0x14) == ["overload (z)"]
    assert said(0x0B) == ["error in a channel (x, y)"]
    assert said(0xA0) == ["system integrity error", "outside operating conditions"]


def test_whatever_comes_before_the_first_datagram_is_no_fault() -> None:
    decoder = Stim300()
    noise = bytes([0x90, 1, 2, 3]) * 20 + b"\xb1 part number \xb5 serial"
    samples = decoder.feed(noise + b"".join(sent(5)))
    assert len(samples) == 5
    assert (decoder.crc_errors, decoder.skipped) == (0, 0)


def test_damage_costs_one_datagram_and_is_counted() -> None:
    datagrams = sent(100)
    for victim in range(10, 90, 10):
        damaged = bytearray(datagrams[victim])
        damaged[victim % SIZE] ^= 0x10
        datagrams[victim] = bytes(damaged)
    decoder = Stim300()
    samples = decoder.feed(b"".join(datagrams))
    assert len(samples) == 92
    assert decoder.crc_errors == 8
    assert decoder.skipped == 8 * SIZE


def test_a_lost_byte_is_found_again() -> None:
    datagrams = sent(20)
    wire = b"".join(datagrams)
    decoder = Stim300()
    samples = decoder.feed(wire[: 5 * SIZE + 4] + wire[5 * SIZE + 5 :])
    assert [s.counter for s in samples] == [4 * k % 256 for k in range(20) if k != 5]
    assert decoder.crc_errors == 1


def test_lines_may_end_in_cr_lf() -> None:
    decoder = Stim300()
    assert len(decoder.feed(b"".join(one + b"\r\n" for one in sent(50)))) == 50
    assert (decoder.crc_errors, decoder.skipped) == (0, 0)


@pytest.mark.moderate
@given(st.binary(max_size=300))
def test_no_bytes_upset_the_decoder(data: bytes) -> None:
    decoder = Stim300()
    decoder.feed(data)
    (datagram, *_), *_ = golden()
    assert decoder.feed(bytes(LONGEST) + datagram)[-1].codes == (0, 0, 0)
