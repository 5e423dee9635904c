"""`python -m device_emulator.stim300`: an emulated Sensonor STIM300 that sends rate-only datagrams over a pty.

Prints one line, `ready stim300:/dev/pts/N`, waits for a reader and sends until SIGTERM or until nobody reads any more.
The datagram is made here once more from the layout, with a checksum of its own, so that encoder and decoder share no
code; the layout they share, and `hil/sensors/protocols.toml` says where that comes from. Like the sensor, it cannot
wait: what the line does not take is lost.
"""

import argparse
import sys
from collections.abc import Iterator

import numpy as np

from device_emulator.serve import send_paced, stop_signal
from hil.wire.errors import LinkClosed, WireError
from hil.wire.pty_link import open_pty

INTERNAL_HZ = 2000
RATES_HZ = (125, 250, 500, 1000, 2000)
LATENCY_US = 506  # at 500 samples a second, about
STARTING = 1 << 6


def checksum(body: bytes) -> int:
    """Remainder of the message, as a polynomial over two elements, by x³² + x²⁶ + … + 1; the register starts full."""
    register = 0xFFFFFFFF
    for byte in body + bytes(-len(body) % 4):
        for bit in range(7, -1, -1):
            carry = (register >> 31) ^ (byte >> bit & 1)
            register = (register << 1) & 0xFFFFFFFF
            if carry:
                register ^= 0x04C11DB7
    return register


def datagram(codes: tuple[int, int, int], status: int, counter: int, latency_us: int) -> bytes:
    """One rate-only datagram of 18 bytes; codes are 2⁻¹⁴ °/s."""
    body = bytes([0x90]) + b"".join((code & 0xFFFFFF).to_bytes(3, "big") for code in codes)
    body += bytes([status, counter & 0xFF]) + latency_us.to_bytes(2, "big")
    return body + checksum(body).to_bytes(4, "big")


def stream(options: argparse.Namespace) -> Iterator[bytes]:
    """Datagram after datagram, damaged or lost (b"") as the options say; noise and harm follow the seed."""
    random = np.random.default_rng(options.seed)
    step, sample = INTERNAL_HZ // options.sample_rate if options.count == "samples" else 1, 0
    while True:
        seconds = sample / options.sample_rate
        turning = options.rate + options.amplitude * np.sin(2.0 * np.pi * options.frequency * seconds)
        rates = np.array([0.0, 0.0, turning]) + options.noise * random.standard_normal(3)
        x, y, z = np.clip(np.rint(rates * 2.0**14), -(2**23), 2**23 - 1).astype(int).tolist()
        status = options.status | (STARTING if seconds < options.start_up else 0)
        sent = bytearray(datagram((x, y, z), status, sample * step, LATENCY_US))
        if random.random() < options.corrupted:
            sent[random.integers(len(sent))] ^= 1 << random.integers(8)
        lost = random.random() < options.lost
        yield b"" if lost else bytes(sent) + (b"\r\n" if options.crlf else b"")
        sample += 1


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="device_emulator.stim300", description="An emulated STIM300 on a pty.")
    number, whole = float, int
    parser.add_argument("--sample-rate", type=whole, choices=RATES_HZ, default=500, help="datagrams a second")
    parser.add_argument("--rate", type=number, default=10.0, metavar="DPS", help="about z (default 10 deg/s)")
    parser.add_argument("--amplitude", type=number, default=0.0, metavar="DPS", help="of a sine on top")
    parser.add_argument("--frequency", type=number, default=1.0, metavar="HZ", help="of that sine")
    parser.add_argument("--noise", type=number, default=0.02, metavar="DPS", help="rms of a sample (default 0.02)")
    parser.add_argument("--corrupted", type=number, default=0.0, metavar="SHARE", help="datagrams with a flipped bit")
    parser.add_argument("--lost", type=number, default=0.0, metavar="SHARE", help="datagrams never sent")
    parser.add_argument("--status", type=lambda text: int(text, 0), default=0, metavar="BYTE", help="status byte")
    parser.add_argument("--start-up", type=number, default=0.0, metavar="S", help="with the start-up bit set")
    parser.add_argument("--count", choices=("samples", "datagrams"), default="samples", help="what the counter counts")
    parser.add_argument("--crlf", action="store_true", help="end datagrams with CR LF")
    parser.add_argument("--seed", type=whole, default=1)
    options = parser.parse_args(arguments)
    try:
        with stop_signal() as stop:
            link = open_pty()
            print(f"ready stim300:{link.path}", flush=True)
            # Nobody has to read: the master's side takes what fits, the rest is lost as on a real line.
            datagrams = ([one] for one in stream(options))
            send_paced(lambda _: datagrams, options.sample_rate, lambda sent: link.offer(b"".join(sent)), stop)
            link.close()
    except LinkClosed:
        return 0
    except WireError as error:
        print(f"device_emulator.stim300: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
