"""`python -m device_emulator.gyros NAME`: an emulated commercial gyro on a pty, or on CAN by `--link can:vcan0`.

Prints one line, `ready serial:/dev/pts/N`, and sends until SIGTERM or until nobody reads any more. Each frame is put
together here byte by byte from the maker's page; nothing is shared with the decoders and their declarations. A line has
a baud rate as `--baud` says: read at another one, its bytes arrive as a receiver of that rate samples the line's bits.
"""

import argparse
import fcntl
import math
import random
import struct
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import can
import numpy as np

from device_emulator.rate import pieces as profile
from device_emulator.scenario import load
from device_emulator.serve import send_paced, stop_signal
from hil.wire.errors import LinkClosed, WireError
from hil.wire.pty_link import PtyLink, open_pty

G = 9.80665
Frame = bytes | can.Message


class Motion(NamedTuple):
    """One sample: its number, time, rates in °/s, acceleration in g, temperature in °C, status as the sensor has it."""

    n: int
    t_s: float
    rate: tuple[float, float, float]
    acc: tuple[float, float, float] = (0.0, 0.0, 1.0)
    temp: float = 25.0
    status: int = 0


def crc32(body: bytes) -> int:
    """Of a STIM300: the message's remainder, as a polynomial over two elements, by x³² + x²⁶ + … + 1, from all ones."""
    register = 0xFFFFFFFF
    for byte in body + bytes(-len(body) % 4):
        for bit in range(7, -1, -1):
            carry = (register >> 31) ^ (byte >> bit & 1)
            register = (register << 1) & 0xFFFFFFFF
            if carry:
                register ^= 0x04C11DB7
    return register


def stim(motion: Motion, identifier: int = 0x90, crlf: bool = False) -> bytes:
    """TS1524, table 5-20; an identifier's lowest three bits say what is in it, and PPS (0xF…) or AUX (0x98 to 0xAF)."""
    more = identifier if identifier < 0xF0 else identifier & 0x07
    auxiliary = identifier >= 0xF0 or more & 0x08
    clusters = [(motion.rate, 2**14, motion.temp)]
    if more & 1:
        clusters.append((motion.acc, 2**19, motion.temp + 1))
    if more & 2:
        clusters.append((motion.acc, 2**22, motion.temp + 2))
    body = bytes([identifier])
    for values, steps, _ in clusters:
        body += b"".join(struct.pack(">i", round(value * steps))[1:] for value in values) + bytes([motion.status])
    if more & 4:
        for _, _, temp in clusters:
            body += struct.pack(">3hB", *(round(temp * 256),) * 3, motion.status)
    if auxiliary:
        body += struct.pack(">i", 1000)[1:] + bytes([motion.status])
    body += struct.pack(">BH", round(2000 * motion.t_s) & 0xFF, 506)  # its own 2000 samples a second
    return body + struct.pack(">I", crc32(body)) + (b"\r\n" if crlf else b"")


def _ccitt(data: bytes) -> int:
    """The user manual's CRC16: x¹⁶ + x¹² + x⁵ + 1 from zero, by its shifts."""
    crc = 0
    for byte in data:
        crc = (crc >> 8 | crc << 8) & 0xFFFF
        crc ^= byte
        crc ^= (crc & 0xFF) >> 4
        crc ^= crc << 12 & 0xFFFF
        crc ^= (crc & 0xFF) << 5 & 0xFFFF
    return crc


def vn100(motion: Motion) -> bytes:
    """Groups 1 and 3: start-up time, angular rate, acceleration; temperature."""
    radians = [math.radians(value) for value in motion.rate]
    body = struct.pack("<BHH", 0b101, 1 << 0 | 1 << 5 | 1 << 8, 1 << 4)
    body += struct.pack("<Q7f", round(motion.t_s * 1e9), *radians, *(G * one for one in motion.acc), motion.temp)
    return b"\xfa" + body + struct.pack(">H", _ccitt(body))


def vn100_ascii(motion: Motion) -> bytes:
    """`$VNYMR`: attitude, magnetic field, acceleration, rate."""
    x, y, z = (math.radians(value) for value in motion.rate)
    ax, ay, az = (G * one for one in motion.acc)
    body = (
        f"VNYMR,+000.000,+000.000,+000.000,+00.2000,+00.0000,+00.4000,{ax:+07.3f},{ay:+07.3f},{az:+07.3f},"
        f"{x:+010.6f},{y:+010.6f},{z:+010.6f}"
    )
    check = 0
    for letter in body.encode():
        check ^= letter
    return f"${body}*{check:02X}\r\n".encode()


def xsens(motion: Motion) -> bytes:
    """Counter, time in 0.1 ms, acceleration, rate, temperature in every tenth, status: filter valid."""
    radians = [math.radians(value) for value in motion.rate]
    data = struct.pack(">HBH", 0x1020, 2, motion.n & 0xFFFF) + struct.pack(">HBI", 0x1060, 4, round(motion.t_s * 1e4))
    data += struct.pack(">HB3f", 0x4020, 12, *(G * one for one in motion.acc))
    data += struct.pack(">HB3f", 0x8020, 12, *radians)
    if motion.n % 10 == 0:
        data += struct.pack(">HBf", 0x0810, 4, motion.temp)
    data += struct.pack(">HBI", 0xE020, 4, motion.status | 3)
    frame = bytes([0xFF, 0x36, len(data)]) + data
    return b"\xfa" + frame + bytes([(256 - sum(frame) % 256) % 256])


def dmu11(motion: Motion) -> bytes:
    """34 words: header, count, rate and acceleration by axis, AUX, temperature, increments by axis, flags, reserved."""
    (x, y, z), (ax, ay, az) = motion.rate, motion.acc
    values = (x, ax, y, ay, z, az, 0.0, motion.temp, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    body = struct.pack(">HH14f3H", 0x55AA, motion.n & 0xFFFF, *values, motion.status, 0, 0)
    words = sum(body[at] << 8 | body[at + 1] for at in range(0, len(body), 2))
    return body + struct.pack(">H", -words & 0xFFFF)


def hg4930(motion: Motion) -> bytes:
    """Five control messages and one inertial message, which has the increments besides."""
    inertial = motion.n % 6 == 5
    rates = [round(math.radians(value) / (600 * 2**-20)) for value in motion.rate]
    accs = [round(one * G / (600 * 0.3048 * 2**-14)) for one in motion.acc]
    status_2b = 0x8000 | round(motion.temp) & 0xFF
    body = struct.pack(
        "<BB6h2H", 0x0E, 2 if inertial else 1, *rates, *accs, motion.status & ~3 | motion.n & 3, status_2b
    )
    if inertial:
        body += struct.pack("<6i", *(0,) * 6)
    words = struct.unpack(f"<{len(body) // 2}H", body)
    return body + struct.pack("<H", sum(words) % 65536)


def hg4930s(motion: Motion) -> bytes:
    """The S-class's 20 bytes."""
    rates = [round(value / (499 * 2**-15)) for value in motion.rate]
    accs = [round(one * G / (21 * 9.805989024 * 2**-15)) for one in motion.acc]
    body = struct.pack("<BB6h2H", 0x0E, 0xCA, *rates, *accs, motion.status & ~3 | motion.n & 3, 0x8019)
    return body + struct.pack("<H", sum(struct.unpack("<9H", body)) % 65536)


def iim46234(motion: Motion) -> bytes:
    """46 bytes in floating point, closed by CR LF."""
    body = struct.pack(">BBBQ7f", 0xAB, motion.status, motion.n & 0xFF, round(motion.t_s * 1e6), *motion.acc,
                       *motion.rate, motion.temp)  # fmt: skip
    return b"##" + bytes([46]) + body + struct.pack(">H", sum(body) & 0xFFFF) + b"\r\n"


def bosch_mm(motion: Motion) -> list[can.Message]:
    """0x174: yaw and lateral; 0x178: roll and longitudinal; 0x17C: pitch and vertical; one counter."""
    messages = []
    for identifier, rate, acc, byte in ((0x174, 2, 1, round(motion.temp) + 50), (0x178, 0, 0, 0), (0x17C, 1, 2, 0)):
        raw_rate = round((motion.rate[rate] + 163.84) / 0.005)
        raw_acc = round((motion.acc[acc] + 4.1768) / 0.000127465)
        data = struct.pack("<HBBHBB", raw_rate, (motion.status & 15) << 4, byte, raw_acc, motion.n & 15, 0)
        messages.append(can.Message(arbitration_id=identifier, is_extended_id=False, data=data))
    return messages


def j1939(motion: Motion) -> list[can.Message]:
    """PGN 61482: pitch, roll, yaw; then PGN 61485."""
    x, y, z = (round((value + 250.0) * 128.0) for value in motion.rate)
    ax, ay, az = (round((one * G + 320.0) / 0.01) for one in motion.acc)
    return [
        can.Message(arbitration_id=0x0CF02A80, data=struct.pack("<HHHH", y, x, z, 0xFFFF)),
        can.Message(arbitration_id=0x0CF02D80, data=struct.pack("<HHHH", ay, ax, az, 0xFFFF)),
    ]


def nmea2000(motion: Motion) -> list[can.Message]:
    """PGN 127251: a sequence number, the rate of turn in 1/32 µrad/s, three bytes of ones."""
    turn = round(math.radians(motion.rate[2]) * 32e6)
    return [
        can.Message(arbitration_id=3 << 26 | 0x1F11334, data=struct.pack("<Bi3s", motion.n % 253, turn, b"\xff" * 3))
    ]


def furuno(motion: Motion) -> list[can.Message]:
    """PGN 130842 as a fast packet: 6 bytes of it in the first frame, 7 in each further one."""
    rates = [round(value * 1000) for value in motion.rate]
    payload = struct.pack("<H3ib3ih", 1855 | 3 << 11 | 4 << 13, 0, 0, 0, 0, *rates, 0)
    sequence = motion.n % 8 << 5
    parts = [bytes([sequence, len(payload)]) + payload[:6]]
    parts += [bytes([sequence | 1 + at // 7]) + payload[6 + at : 13 + at] for at in range(0, len(payload) - 6, 7)]
    identifier = 7 << 26 | 130842 << 8 | 0x34
    return [can.Message(arbitration_id=identifier, data=part.ljust(8, b"\xff")) for part in parts]


class Gyro(NamedTuple):
    """An emulated gyro: what makes its frames, samples a second, baud rate (0: on CAN)."""

    frames: Callable[[Motion], bytes] | Callable[[Motion], list[can.Message]]
    rate_Hz: float
    baud: int = 0


GYROS = {
    "stim300": Gyro(stim, 500.0, 921600),
    "vn100": Gyro(vn100, 100.0, 115200),
    "vn100-ascii": Gyro(vn100_ascii, 40.0, 115200),
    "xsens": Gyro(xsens, 100.0, 115200),
    "dmu11": Gyro(dmu11, 200.0, 460800),
    "hg4930": Gyro(hg4930, 600.0, 1000000),
    "hg4930s": Gyro(hg4930s, 3600.0, 1000000),
    "iim46234": Gyro(iim46234, 250.0, 921600),
    "bosch-mm": Gyro(bosch_mm, 100.0),
    "j1939": Gyro(j1939, 100.0),
    "nmea2000": Gyro(nmea2000, 10.0),
    "furuno": Gyro(furuno, 10.0),
}


def stream(
    gyro: Gyro, *, rate: "float | Callable[[float], float]" = 10.0, noise: float = 0.02, lost: float = 0.0,
    corrupted: float = 0.0, seed: int = 1, restart: int = 0,
) -> Iterator[Sequence[Frame]]:  # fmt: skip
    """The frames of sample after sample; noise and harm follow the seed; after `restart` samples it begins anew.
    A rate may be one of the time since it began to send."""
    chance = random.Random(seed)
    n = since = 0
    while True:
        since += 1
        turn = rate(since / gyro.rate_Hz) if callable(rate) else rate
        x, y, z = (mean + chance.gauss(0.0, noise) for mean in (-1.0, 2.0, turn))
        made = gyro.frames(Motion(n, n / gyro.rate_Hz, (x, y, z)))
        n = 0 if restart and n + 1 == restart else n + 1
        if chance.random() < lost:
            yield []
        elif isinstance(made, bytes):
            sent = bytearray(made)
            if chance.random() < corrupted:
                sent[chance.randrange(len(sent))] ^= 1 << chance.randrange(8)
            yield [bytes(sent)]
        else:
            yield made


def turning(scenario: Path, since_s: float) -> Callable[[float], float]:
    """The rate in °/s of a scenario's device by the monotonic clock, its profile having begun at `since_s`: so the gyro
    turns as an emulated board does that began then."""
    pieces = profile(load(scenario).rate)

    def rate(now_s: float) -> float:
        piece = pieces[max(int(np.searchsorted(pieces["start_s"], now_s - since_s, "right")) - 1, 0)]
        tau = now_s - since_s - piece["start_s"]
        swing = piece["amplitude_rad_s"] * math.sin(piece["frequency_rad_s"] * tau + piece["phase_rad"])
        return math.degrees(piece["rate_rad_s"] + piece["slope_rad_s2"] * tau + swing)

    return rate


_TCGETS2 = 0x802C542A
"""Of Linux: `struct termios2` of a terminal; four flags, a line discipline and 19 characters before the two speeds."""


def sampled(data: bytes, sent_baud: int, read_baud: int) -> bytes:
    """What a receiver at `read_baud` makes of bytes sent one after the other at `sent_baud`, eight bits, no parity.

    It waits for the edge of a start bit, samples the middle of eight bits of its own length, and waits for the next
    edge from the middle of the stop bit on, whatever that is: so do a UART and Linux' raw mode.
    """
    levels = [bit for byte in data for bit in (0, *(byte >> k & 1 for k in range(8)), 1)]
    ratio, heard, at = sent_baud / read_baud, bytearray(), 0
    while at < len(levels):
        if levels[at] or (at and not levels[at - 1]):
            at += 1
            continue
        places = [int(at + (k + 1.5) * ratio) for k in range(8)]
        heard.append(sum(1 << k for k, place in enumerate(places) if place >= len(levels) or levels[place]))
        at = int(at + 9.5 * ratio) + 1
    return bytes(heard)


class _Line:
    """A pty that is read at the right baud rate, or gives what a receiver makes of the wrong one."""

    def __init__(self, link: PtyLink, baud: int) -> None:
        self._link, self._baud = link, baud

    def send(self, data: bytes) -> None:
        settings = fcntl.ioctl(self._link.fileno(), _TCGETS2, bytes(44))
        read_baud = int.from_bytes(settings[40:44], sys.byteorder)
        self._link.offer(data if read_baud in (0, self._baud) else sampled(data, self._baud, read_baud))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="device_emulator.gyros", description="An emulated commercial gyro.")
    parser.add_argument("name", choices=sorted(GYROS))
    parser.add_argument("--link", default="pty", help="pty, or can:NAME of one on CAN")
    parser.add_argument("--sample-rate", type=float, help="samples a second, instead of its own")
    parser.add_argument("--baud", type=int, help="of its line; read at another one it is garbled")
    for name, default in (("rate", 10.0), ("noise", 0.02), ("lost", 0.0), ("corrupted", 0.0)):
        parser.add_argument(f"--{name}", type=float, default=default)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--turn", type=Path, help="a scenario as whose device it turns about z, instead of --rate")
    parser.add_argument("--since", type=float, help="when that began, in seconds of the monotonic clock; default now")
    options = parser.parse_args(arguments)
    gyro = GYROS[options.name]
    gyro = gyro._replace(rate_Hz=options.sample_rate or gyro.rate_Hz)
    harm = {name: getattr(options, name) for name in ("rate", "noise", "lost", "corrupted", "seed")}
    since_s = time.monotonic() if options.since is None else options.since
    turns = None if options.turn is None else turning(options.turn, since_s)

    def samples(begun_s: float) -> Iterator[Sequence[Frame]]:
        turn = {} if turns is None else {"rate": lambda t_s: turns(begun_s + t_s)}
        return stream(gyro, **harm | turn)

    try:
        with stop_signal() as stop:
            if gyro.baud:
                link = open_pty()
                line = _Line(link, options.baud or gyro.baud)
                print(f"ready serial:{link.path}", flush=True)
                send_paced(samples, gyro.rate_Hz, lambda frames: line.send(b"".join(map(_bytes, frames))), stop)
                link.close()
            else:
                from hil.wire.can_adapter import open_bus
                from hil.wire.link_name import CanAdapter, CanInterface, parse_link

                place = parse_link(options.link)
                assert isinstance(place, CanInterface | CanAdapter), "--link can:NAME"
                with open_bus(options.link, place) as bus:
                    print(f"ready {options.link}", flush=True)
                    send_paced(samples, gyro.rate_Hz, lambda frames: _onto(bus, frames), stop)
    except LinkClosed:
        return 0
    except WireError as error:
        print(f"device_emulator.gyros: {error}", file=sys.stderr)
        return 2
    return 0


def _onto(bus: can.BusABC, frames: Sequence[Frame]) -> None:
    for frame in frames:
        assert isinstance(frame, can.Message)
        bus.send(frame)


def _bytes(frame: Frame) -> bytes:
    assert isinstance(frame, bytes)
    return frame


if __name__ == "__main__":
    sys.exit(main())
