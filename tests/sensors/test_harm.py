"""What goes wrong on each of the wires: samples lost, damaged and cut, a sensor that begins anew, a wrong baud rate."""

import math
import random
from collections.abc import Sequence
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import can
import pytest

import hil
from device_emulator.gyros import GYROS, Motion, sampled, stream
from hil.sensors.adapter import Sample
from hil.sensors.declared import protocols
from hil.sensors.port import adapter_called, usual_bauds
from hil.sensors.stream_decoder import StreamDecoder
from hil.sensors.ticks import TickCounter
from hil.wire.errors import LinkError
from tests.sensors.test_gyros import ON_LINES, decoder, spoken

TOLD = ("vn100", "xsens", "dmu11", "iim46234")
"""Whose counter (2^15 or more values, and no stamp of the bus) never turns within a gap: going back it began anew.  A
new sensor with such a counter belongs here."""

AFTER = {"stim300": 32, "hg4930": 2, "hg4930s": 2}
"""Samples by which half a turn of a short counter may be off after an outage; of others what came at once."""


class Wire:
    """Slots of time, of each sample one, and what is sent in each; the rate about z says which slot it is of."""

    def __init__(self, name: str) -> None:
        self.name, self.rate_Hz = name, GYROS[name].rate_Hz
        self.slots = max(round(3.0 * self.rate_Hz), 120)
        self.outage = range(self.slots // 2, self.slots // 2 + round(0.8 * self.rate_Hz))
        chance = random.Random(4)
        picked = [s for s in range(40, self.slots - 3, 3) if s not in self.outage and s < self.slots]
        chance.shuffle(picked)
        self.lost, self.half, self.damaged = (set(picked[k : k + 4]) for k in (0, 4, 8))

    @property
    def sound(self) -> list[int]:
        harmed = self.lost | self.half | self.damaged | set(self.outage)
        return [slot for slot in range(self.slots) if slot not in harmed]

    def sent(self, slot: int) -> list[Any]:
        """Frames of a slot, bytes or CAN messages, with what befell them."""
        if slot in self.lost or slot in self.outage:
            return []
        n = slot - (self.outage[-1] + 1 if slot > self.outage[-1] else 0)
        rate = (-1.0, 2.0, 300.0 * (slot / self.slots - 0.5))
        made = GYROS[self.name].frames(Motion(n, n / self.rate_Hz, rate))
        if isinstance(made, bytes):
            if slot in self.half:
                return [made[: len(made) // 2]]
            return [bytes([*made[:7], made[7] ^ 4, *made[8:]])] if slot in self.damaged else [made]
        for message in made:
            message.timestamp = 1.7e9 + slot / self.rate_Hz
        if slot in self.half | self.damaged and self.name in ("bosch-mm", "furuno"):
            return made[:-1]  # of the messages of one sample the last is missing
        if slot in self.half | self.damaged:
            made[0] = can.Message(arbitration_id=made[0].arbitration_id, data=made[0].data[:4])
        return made

    def slot_of(self, channels: Sequence[Any], sample: Sample) -> int:
        """Which slot a sample is of, by its rate."""
        at = next(k for k, column in enumerate(channels) if column.name == "rate_z_code")
        z = math.degrees(sample.codes[at] * channels[at].scale)
        return round((z / 300.0 + 0.5) * self.slots)


@pytest.mark.parametrize("name", list(GYROS))
def test_lost_cut_and_damaged_samples_and_a_sensor_that_begins_anew(name: str) -> None:
    """Every sound sample is found at its place in time, nothing else is; what was harmed is counted."""
    wire, made = Wire(name), adapter_called(name, name)
    assert made is not None
    ticks: TickCounter | None = None
    at_once = max(round(0.01 * wire.rate_Hz), 1)
    found: list[tuple[int, int]] = []
    for first in range(0, wire.slots + at_once, at_once):
        frames = [one for slot in range(first, min(first + at_once, wire.slots)) for one in wire.sent(slot)]
        data = b"".join(frames) if isinstance(made, StreamDecoder) else frames
        samples = list(made.feed(data)) if data else []
        if samples and ticks is None:
            counts_itself = getattr(made, "counts_itself", False)
            ticks = TickCounter(
                made.counter_size, made.rates_Hz, getattr(made, "counter_Hz", 0.0), is_ours=counts_itself
            )
        if samples and ticks is not None:
            numbered = ticks.number(samples, (first + at_once) / wire.rate_Hz)
            found += [(tick, wire.slot_of(made.channels, sample)) for tick, sample in numbered]
    assert ticks is not None
    assert ticks.sample_rate_Hz == wire.rate_Hz
    slots = [slot for _, slot in found]
    sound = set(wire.sound)
    assert set(slots) <= sound
    assert len(set(slots)) == len(slots)
    assert len(slots) >= len(sound) - 12  # the first of a bus, the last that nothing follows, the next behind a cut one

    begun = slots[0]
    unseen = len(wire.lost) if getattr(made, "counts_itself", False) else 0  # where no counter tells of one sample
    for tick, slot in found:
        late = slot > wire.outage[-1]
        allowed = unseen + late * (AFTER.get(name, 0) + (0 if wire_is_can(name) else at_once + 1))
        assert abs(tick + begun - slot) <= allowed, (tick, slot)
    assert ticks.restarts == (name in TOLD)
    harmed = made.crc_errors + getattr(made, "incomplete", 0)
    assert harmed == pytest.approx(len(wire.half | wire.damaged), abs=1)


def wire_is_can(name: str) -> bool:
    return not GYROS[name].baud


@cache
def spoken_bytes(name: str) -> bytes:
    return b"".join(one for sent in islice(stream(GYROS[name]), 400) for one in sent if isinstance(one, bytes))


def test_a_receiver_samples_the_bits_of_the_line() -> None:
    """By hand: 00 is nine bits low, of twice the rate 18, then the stop bit; FF has a start bit alone."""
    assert sampled(bytes(range(256)), 115200, 115200) == bytes(range(256))
    assert sampled(bytes(range(256)), 115200, 117000) == bytes(range(256))
    assert sampled(b"\x00\xff", 9600, 19200) == b"\x00\xfe"
    assert sampled(b"\x0f", 28800, 9600) == b"\xfd"  # 0 1111 0000 1 from 4.5 on every third: 1, 0, then idle


@pytest.mark.parametrize("name", ON_LINES)
def test_at_a_wrong_baud_rate_there_is_no_frame(name: str) -> None:
    """Of none of the protocols, at any of the usual rates."""
    assert decoder(name).feed(spoken_bytes(name))
    for baud in usual_bauds():
        garbled = sampled(spoken_bytes(name), GYROS[name].baud, baud)
        if baud == GYROS[name].baud:
            assert garbled == spoken_bytes(name)
            continue
        assert garbled
        for other in protocols():
            made = decoder(other)
            made.feed(garbled)
            assert made.frames == 0, (other, baud)


@pytest.mark.realtime
@pytest.mark.parametrize("name", ON_LINES)
def test_a_wrong_baud_rate_is_told_with_the_right_one(tmp_path: Path, name: str) -> None:
    right = GYROS[name].baud
    wrong = next(baud for baud in (*protocols()[name].bauds, 115200) if baud != right)
    with spoken(GYROS[name]) as path:
        told = rf"[1-9]\d* bytes were heard at {wrong} baud, but not enough datagrams in 2 s.*"
        told += rf"; {name} speaks there at {right} baud: record {name}:{path}\?baud={right}$"
        with pytest.raises(LinkError, match=told):
            hil.record(f"{name}:{path}?baud={wrong}", out=tmp_path)
    assert not list(tmp_path.iterdir())
