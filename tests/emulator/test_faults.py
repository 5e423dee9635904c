"""Faults of a scenario: on the line frame by frame, in lockstep and on wall time; in the sense chain; in the supply."""

import numpy as np
import pytest
from pydantic import ValidationError

from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.faults import Faults
from device_emulator.line import Line, Unplugged
from device_emulator.scenario import Scenario
from hil.wire.framing import Decoder
from hil.wire.messages import (
    Arm,
    ClockMode,
    DriveForce,
    Hello,
    Message,
    Nack,
    RegisterRead,
    RegisterValue,
    SafeReason,
    State,
    Status,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter
from tests.emulator.gyro import record, scenario, undriven, volts

RATE_HZ = 4000.0


class Host:
    """A host in lockstep that answers what it gets and keeps the bytes that came."""

    def __init__(self, what: Scenario, clock: ClockMode = ClockMode.LOCKSTEP) -> None:
        self.board = Board(what, Device(what), (clock,))
        self.line = Line(self.board, what)
        self.tx, self.rx = Transmitter(), Receiver()
        self.ticks: list[int] = []
        self.heard: list[Message] = []
        self.bytes = b""

    def say(self, message: Message) -> None:
        self.hear(self.line.exchange(self.tx.encode(message, self.rx.tick)))

    def hear(self, data: bytes) -> None:
        self.bytes += data
        for item in self.rx.feed(data):
            self.heard.append(item.message)
            if isinstance(item.message, Sense):
                self.ticks.append(item.tick)

    def arm(self) -> None:
        self.say(Hello(SPEC.protocol, SPEC.hash))
        self.say(Arm())

    def answer(self, times: int) -> None:
        """Answer the newest sample, so many times; each answer must bring another sample."""
        for _ in range(times):
            before = len(self.ticks)
            self.say(DriveForce(100, -50, self.ticks[-1] + 1))
            assert len(self.ticks) > before, "the board waits for a host that waits for the board"


def armed(**faults: object) -> Host:
    host = Host(scenario({"faults": faults}))
    host.arm()
    return host


@pytest.mark.moderate
@pytest.mark.parametrize("seed", range(5))
def test_every_harmed_frame_is_a_gap_in_a_sequence(seed: int) -> None:
    host = Host(scenario({"seed": seed, "faults": {"lost": 0.03, "corrupted": 0.03}}))
    host.arm()
    host.answer(2000)
    harmed = host.line.inflicted
    to_host = harmed["lost_to_host"] + harmed["corrupted_to_host"]
    to_board = harmed["lost_to_board"] + harmed["corrupted_to_board"]
    assert to_host > 60
    assert to_board > 60
    assert host.rx.lost == to_host
    assert host.board.status().lost_seq in (to_board, to_board - 1)  # a gap shows when the next frame comes
    assert host.rx.bad >= harmed["corrupted_to_host"] - 1  # two frames can flow together when a boundary is hit
    missing = set(range(host.ticks[-1])) - set(host.ticks)
    assert len(missing) == to_host


@pytest.mark.moderate
def test_a_tick_passes_for_each_frame_lost() -> None:
    """Bench time goes on where a sample got lost; where a drive did, its tick passes with the last one held."""
    host = armed(lost=0.05)
    host.answer(1000)
    harmed = host.line.inflicted
    assert host.board.tick == 1000 + harmed["lost_to_host"]
    assert host.board.status().held == pytest.approx(sum(harmed.values()), abs=5)  # twice in a tick is once


@pytest.mark.moderate
def test_the_same_seed_harms_the_same_frames_and_another_does_not() -> None:
    faults = {"lost": 0.02, "corrupted": 0.02, "duplicated": 0.02, "reordered": 0.02}

    def bytes_of(seed: int) -> bytes:
        host = Host(scenario({"seed": seed, "faults": faults}))
        host.arm()
        host.answer(300)
        return host.bytes

    assert bytes_of(1) == bytes_of(1)
    assert bytes_of(1) != bytes_of(2)


@pytest.mark.moderate
def test_duplicates_are_dropped_at_both_ends() -> None:
    host = armed(duplicated=0.1)
    host.answer(1000)
    harmed = host.line.inflicted
    assert host.rx.repeated == harmed["duplicated_to_host"] > 50
    assert harmed["duplicated_to_board"] > 50
    assert host.ticks == list(range(1001))  # and no tick passed for them


@pytest.mark.moderate
def test_an_overtaken_sample_is_lost_to_the_loop_and_counted() -> None:
    host = armed(reordered=0.1, toward="host")
    host.answer(1000)
    assert host.line.inflicted["reordered_to_host"] == pytest.approx(111, abs=40)
    assert host.rx.lost == host.rx.repeated  # each gap was filled too late
    assert host.ticks == sorted(host.ticks)


@pytest.mark.moderate
def test_a_late_frame_that_is_no_news_leaves_nobody_waiting() -> None:
    """Found by seed 1 of the benchmark: the host drops a sample that comes after a later one, and owes no answer."""
    host = Host(scenario({"seed": 1, "faults": {"delayed": 0.05, "delay_s": [0.0002, 0.002], "duplicated": 0.05}}))
    host.arm()
    host.answer(2000)
    assert host.rx.repeated > 50


@pytest.mark.moderate
@pytest.mark.parametrize("faults", [{"delayed": 0.5, "delay_s": [0.0, 0.002]}, {"baud": 500_000.0}])
def test_before_one_tick_the_host_gets_one_sample_to_answer(faults: dict[str, object]) -> None:
    """However a link cuts what it carries: found over UDP, where two samples came as two and were both answered."""
    host = armed(**faults)
    for _ in range(300):
        before = len(host.ticks)
        host.answer(1)
        assert len(host.ticks) == before + 1


@pytest.mark.moderate
def test_delayed_drives_come_late_and_are_counted() -> None:
    host = armed(delayed=0.2, delay_s=[0.0005, 0.003], toward="board")
    host.answer(1000)
    delayed = host.line.inflicted["delayed_to_board"]
    status = host.board.status()
    assert delayed > 150
    assert 0 < status.late <= delayed
    assert status.held >= status.late


def test_a_slow_baud_rate_makes_every_answer_late() -> None:
    """27 bytes there and 24 back take 0.17 ms at 3 MBd and 0.51 ms at 1 MBd; the tick lasts 0.25 ms."""
    fast, slow = armed(baud=3_000_000.0), armed(baud=1_000_000.0)
    for host in (fast, slow):
        host.answer(100)
    assert fast.board.status().late == 0
    assert slow.board.status().late > 50


@pytest.mark.moderate
def test_what_does_not_fit_a_slow_line_is_lost_not_queued_for_ever() -> None:
    host = armed(baud=100_000.0)
    host.answer(300)
    assert host.rx.lost > 300
    delay_s = (host.board.tick - host.ticks[-1]) / RATE_HZ
    assert 0.3 < delay_s < 0.45  # 4096 bytes take 0.41 s


@pytest.mark.moderate
def test_a_stall_holds_everything_and_trips_the_watchdog() -> None:
    host = armed(stall=[{"start_s": 0.05, "duration_s": 0.1}])
    host.answer(199)  # up to the stall, in which the board goes on alone and falls to SAFE
    with pytest.raises(AssertionError, match="waits"):
        host.answer(1)
    assert host.board.state is State.SAFE
    assert isinstance(host.heard[-1], Status)
    assert host.heard[-1].reason == SafeReason.WATCHDOG
    host.say(Arm())
    assert host.ticks[-1] >= 600
    host.answer(10)
    assert host.board.state is State.RUNNING


@pytest.mark.moderate
def test_an_unplugged_line_ends_the_conversation() -> None:
    host = armed(unplugged_s=0.1)
    with pytest.raises(Unplugged):
        host.answer(1000)
    assert host.ticks[-1] == 400
    assert host.board.state is State.SAFE


@pytest.mark.moderate
def test_a_brown_out_leaves_a_board_that_has_forgotten_the_host() -> None:
    host = armed(brown_out=[{"start_s": 0.1, "duration_s": 0.05}])
    host.answer(400)
    host.say(DriveForce(100, 0, host.ticks[-1] + 1))
    assert isinstance(host.heard[-1], Nack)
    assert host.board.state is State.BOOT
    host.say(Arm())
    assert isinstance(host.heard[-1], Nack)
    host.arm()  # HELLO first
    assert host.board.streaming
    assert host.ticks[-1] == 400 + 200 + 1


def test_requests_pass_unharmed_where_nobody_can_wait_for_another() -> None:
    host = Host(scenario({"faults": {"lost": 0.9}}))
    host.arm()
    for register in range(1, 7):
        host.say(RegisterRead(register))
    assert sum(isinstance(message, RegisterValue) for message in host.heard) == 6


def test_on_wall_time_requests_are_lost_too() -> None:
    host = Host(scenario({"faults": {"lost": 0.5}}), ClockMode.PACED)
    for _ in range(200):
        host.say(RegisterRead(1))
    answered = sum(isinstance(message, RegisterValue) for message in host.heard)
    harmed = host.line.inflicted
    assert answered == 200 - harmed["lost_to_board"] - harmed["lost_to_host"]
    assert 20 < answered < 90


def test_on_wall_time_a_delayed_frame_waits_for_its_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("device_emulator.line.time.monotonic", lambda: now)
    host = Host(scenario({"faults": {"delayed": 0.9, "delay_s": [0.5, 0.5], "toward": "board"}}), ClockMode.PACED)
    while not host.line.inflicted["delayed_to_board"]:
        host.say(RegisterRead(1))
    before = len(host.heard)
    assert host.line.due_s() == 100.5
    host.hear(host.line.exchange(b""))
    assert len(host.heard) == before
    now = 100.6
    host.hear(host.line.exchange(b""))
    assert len(host.heard) == before + 1


def test_how_the_hosts_bytes_are_cut_does_not_matter() -> None:
    whole, cut = armed(lost=0.1), armed(lost=0.1)
    for host, step in ((whole, 4096), (cut, 5)):
        for n in range(50):
            frame = host.tx.encode(DriveForce(n, -n, host.ticks[-1] + 1), 0)
            for start in range(0, len(frame), step):
                host.hear(host.line.exchange(frame[start : start + step]))
    assert whole.bytes == cut.bytes


def test_one_to_four_bits_flip_and_no_checksum_overlooks_them() -> None:
    clean = Host(scenario(), ClockMode.PACED)
    dirty = Host(scenario({"faults": {"corrupted": 0.9, "toward": "host"}}), ClockMode.PACED)
    for host in (clean, dirty):
        host.arm()
    flips = []
    for _ in range(100):
        sound, damaged = clean.line.block(), dirty.line.block()
        flips.append(sum((a ^ b).bit_count() for a, b in zip(sound, damaged, strict=True)))
        if flips[-1]:
            assert Decoder().feed(b"\0" + damaged + b"\0") == []
    assert set(flips) == {0, 1, 2, 3, 4}


def test_a_stuck_channel_repeats_its_last_code() -> None:
    faults = {"stuck": [{"axis": "x", "start_s": 0.01, "duration_s": 0.005}]}
    sound, faulty = record(scenario(), undriven(100)).codes, record(scenario({"faults": faults}), undriven(100)).codes
    assert np.array_equal(faulty[:, 1], sound[:, 1])
    assert np.array_equal(faulty[:40, 0], sound[:40, 0])
    assert (faulty[40:60, 0] == sound[39, 0]).all()
    assert np.array_equal(faulty[60:, 0], sound[60:, 0])


def test_a_saturated_channel_goes_no_further() -> None:
    what = scenario({"faults": {"saturated": [{"axis": "x", "start_s": 0.0, "duration_s": 9.0, "limit_V": 0.02}]}})
    sound, faulty = record(scenario(), undriven(200)), record(what, undriven(200))
    lsb = volts(what, np.array([1]))[0]
    limit = int(0.02 / lsb)
    assert np.array_equal(faulty.codes[:, 0], np.clip(sound.codes[:, 0], -limit, limit))
    assert np.ptp(sound.codes[:, 0]) > 3 * limit
    assert not faulty.device.clipped  # it is the amplifier; the converter sees nothing unusual


def test_a_fast_board_clock_makes_the_device_look_slow() -> None:
    """2 % more ticks to a cycle: the zero crossings are 2 % further apart when counted in ticks."""

    def period(**faults: object) -> float:
        codes = record(scenario({"faults": faults}), undriven(4000)).codes[:, 0].astype(float)
        codes -= codes.mean()
        up = np.flatnonzero((codes[:-1] < 0) & (codes[1:] >= 0))
        at = up - codes[up] / (codes[up + 1] - codes[up])
        return float(np.polyfit(np.arange(len(at)), at, 1)[0])

    assert period(clock_skew=0.02) / period() == pytest.approx(1.02, rel=1e-4)


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ({"lost": 0.6, "corrupted": 0.4}, "at most 0.9"),
        ({"delayed": 0.1}, "delay_s says by how much"),
        ({"delayed": 0.1, "delay_s": (0.2, 0.1)}, "least, most"),
        ({"lost": 1.5}, "less than or equal to 1"),
        ({"clock_skew": 0.5}, "less than 0.1"),
        ({"stuck": [{"axis": "z", "start_s": 0.0, "duration_s": 1.0}]}, "'x' or 'y'"),
        ({"stuck": [{"axis": "x", "start_s": 0.0, "duration_s": 1.0}] * 17}, "at most 16"),
    ],
)
def test_what_cannot_happen_is_refused(faults: dict[str, object], expected: str) -> None:
    with pytest.raises(ValidationError, match=expected):
        Faults.model_validate(faults)
