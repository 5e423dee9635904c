"""How many frames a decoder finds in noise, beside what the odds of its checksum allow.

    python -m evaluation.false_frames --bytes 1e9 --begun 1e8

Each protocol of a serial line hears noise twice: bytes at random, and bytes at random behind whole beginnings of
frames, one after another, so that the checksum alone decides. Of the first there may be at most as many frames as
beginnings occur by chance, each with the odds of the checksum. Of the second there are as many as a binomial of these
odds has, within its 99.9 % interval. Exit code 1 where a count is outside.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator

import numpy as np
from scipy.stats import binom

from hil.sensors.declared import Protocol, protocols
from hil.sensors.layouts import Layout, framing_of
from hil.sensors.stream_decoder import StreamDecoder

ODDS = {"crc32": 2.0**-32, "crc16": 2.0**-16, "sum8": 2.0**-8, "sum16": 2.0**-16, "words_zero": 2.0**-16,
        "words_last": 2.0**-16, "none": 2.0**-8}  # fmt: skip
"""Of random bytes in a checksum's place; a sentence has two digits of an exclusive or."""

HEADS = {"vn100": ("fa012101", 38), "xsens": ("faff360f80200c", 20)}
"""Of protocols whose frames tell their length: a head, and the bytes of the whole frame; time, rate and acceleration of
a VN-100, the rate alone of an Xsens."""

SURE = 0.999
_HELPING = 1 << 20


def main() -> int:
    """Go through the protocols; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.false_frames", description=__doc__)
    parser.add_argument("--bytes", type=float, default=1e9, help="at random, of each protocol; default 1e9")
    parser.add_argument("--begun", type=float, default=1e8, help="behind beginnings, of each protocol; default 1e8")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=sorted(protocols()), action="append")
    options = parser.parse_args()
    print("| protocol | noise | bytes | MB/s of processor | beginnings, odds | may be | found | |")
    print("|---|---|---|---|---|---|---|---|")
    outside = 0
    for name in options.only or protocols():
        protocol = protocols()[name]
        chance = np.random.default_rng(options.seed)
        for noise, size in (("random", round(options.bytes)), ("begun", round(options.begun))):
            outside += heard(protocol, noise, size, chance)
    print(f"load {os.getloadavg()[0]:.1f}", file=sys.stderr)
    return min(outside, 1)


def heard(protocol: Protocol, noise: str, size: int, chance: np.random.Generator) -> bool:
    """One row of the table; whether its count is outside."""
    decoder, fed, begun, spent_s = StreamDecoder(protocol), 0, 0, 0.0
    for helping, beginnings in helpings(protocol, noise, size, chance):
        start = time.process_time()
        decoder.feed(helping)
        spent_s += time.process_time() - start
        fed, begun = fed + len(helping), begun + beginnings
    odds = ODDS[protocol.check]
    if noise == "random":
        share = sum(256.0 ** -len(one) for one in starts(protocol)) * 256.0 ** -len(protocol.tail)
        least, most = 0.0, float(binom.ppf(SURE, fed, share * odds))
        told = f"at most {fed * share:.3g}"
    else:
        least, most = (float(end) for end in binom.interval(SURE, begun, odds))
        told = f"{begun}"
    out = not least <= decoder.frames <= most
    print(
        f"| {protocol.name} | {noise} | {fed:.3g} | {fed / max(spent_s, 1e-9) / 1e6:.0f} | {told}, 1 in {1 / odds:.0f} "
        f"| {least:.0f} to {most:.0f} | {decoder.frames} | {'outside' if out else ''} |",
        flush=True,
    )
    return out


def starts(protocol: Protocol) -> list[bytes]:
    """What a frame begins with, by the declaration."""
    how = protocol.how
    if "frames" in how:
        return [bytes.fromhex(one) for one in how["frames"]]
    if "sentences" in how:
        return [f"${one},".encode() for one in how["sentences"]]
    return [bytes.fromhex((how.get("groups") or how["tags"])["sync"])]


def helpings(protocol: Protocol, noise: str, size: int, chance: np.random.Generator) -> Iterator[tuple[bytes, int]]:
    """Noise in pieces, each with how many beginnings were put into it."""
    for left in range(size, 0, -_HELPING):
        if noise == "random":
            yield chance.bytes(min(_HELPING, left)), 0
        elif protocol.name == "vn100-ascii":
            yield sentences(min(_HELPING, left), chance)
        else:
            yield frames(protocol, min(_HELPING, left), chance)


def frames(protocol: Protocol, size: int, chance: np.random.Generator) -> tuple[bytes, int]:
    """Whole frames of random bytes behind their beginning."""
    if protocol.name in HEADS:
        head, length = HEADS[protocol.name]
        begin = bytes.fromhex(head)
    else:
        framing = framing_of(protocol)
        begin = framing.begins[0]
        layout = framing.find(begin, 0)
        assert isinstance(layout, Layout)
        length = layout.size
    rows = chance.integers(0, 256, (max(size // length, 1), length), np.uint8)
    rows[:, : len(begin)] = np.frombuffer(begin, np.uint8)
    if protocol.tail:
        rows[:, -len(protocol.tail) :] = np.frombuffer(protocol.tail, np.uint8)
    return rows.tobytes(), len(rows)


def sentences(size: int, chance: np.random.Generator) -> tuple[bytes, int]:
    """`$VNGYR` with three numbers and two random digits behind the star."""
    count = max(size // 41, 1)
    numbers, digits = chance.normal(0.0, 1.0, (count, 3)), chance.integers(0, 256, count)
    lines = [
        f"$VNGYR,{x:+010.6f},{y:+010.6f},{z:+010.6f}*{digit:02X}\r\n"
        for (x, y, z), digit in zip(numbers.tolist(), digits.tolist(), strict=True)
    ]
    return "".join(lines).encode(), count


if __name__ == "__main__":
    sys.exit(main())
