"""Sold gyros: golden frames, emulated ones written from other sources, harm, noise, and which of them speaks."""

import math
import random
import struct
import threading
import time
from itertools import islice
from pathlib import Path

import can
import numpy as np
import pytest

import hil
from device_emulator.gyros import GYROS, Gyro, Motion, _ccitt, stim, stream
from hil import cli
from hil.errors import InputError
from hil.records.capture import read_capture
from hil.records.rates import rates_rad_s
from hil.sensors.declared import protocols
from hil.sensors.port import adapter_called, find_port, recognised
from hil.sensors.stream_decoder import StreamDecoder
from hil.sensors.ticks import TickCounter
from hil.wire.errors import LinkError
from tests.sensors.golden_frames import BOSCH, CAN, SERIAL
from tests.sensors.spoken import spoken

ON_LINES = [name for name, gyro in GYROS.items() if gyro.baud]
ON_CAN = [name for name, gyro in GYROS.items() if not gyro.baud]
ODDS = {"crc32": 2.0**-32, "crc16": 2.0**-16, "sum8": 2.0**-8, "sum16": 2.0**-16, "words_zero": 2.0**-16,
        "words_last": 2.0**-16, "none": 2.0**-8}  # fmt: skip


def decoder(name: str) -> StreamDecoder:
    return StreamDecoder(protocols()[name])


@pytest.mark.parametrize(("name", "frame", "meant", "source"), SERIAL)
def test_golden_frames(name: str, frame: str | bytes, meant: dict[str, float], source: str) -> None:
    wire = bytes.fromhex(frame) if isinstance(frame, str) else frame
    if name == "xsens" and len(wire) == 4 + wire[3]:
        wire += bytes([-sum(wire[1:]) & 0xFF])  # the page shows this one without its checksum
    for piece in (1, 5, len(wire)):
        made = decoder(name)
        (sample,) = [one for at in range(0, len(wire), piece) for one in made.feed(wire[at : at + piece])]
        said = {c.name.removesuffix("_code"): v for c, v in zip(made.channels, sample.codes, strict=True)}
        said |= {"counter": sample.counter, "status": sample.status}
        assert {key: said[key] for key in meant} == pytest.approx(meant, rel=1e-6, abs=5e-7), source
        assert made.crc_errors == 0


def test_a_vn100_that_sends_the_uncompensated_rate_alone_sends_a_rate() -> None:
    """As in the loggers of waves in ice: group 3 with uncompensated field, acceleration and rate."""
    body = struct.pack("<BH9f", 0b100, 0b1110, *range(9))
    made = decoder("vn100")
    (sample,) = made.feed(b"\xfa" + body + struct.pack(">H", _ccitt(body)))
    said = {column.name: value for column, value in zip(made.channels, sample.codes, strict=True)}
    assert [said[f"rate_{axis}_code"] for axis in "xyz"] == [6.0, 7.0, 8.0]


def frames(name: str, samples: int, **harm: float) -> list[can.Message]:
    made = []
    for n, sent in enumerate(islice(stream(GYROS[name], **harm), samples)):  # type: ignore[arg-type]
        for one in sent:
            assert isinstance(one, can.Message)
            one.timestamp = 1.7e9 + n / GYROS[name].rate_Hz
            made.append(one)
    return made


@pytest.mark.parametrize(("name", "pgn", "payload", "meant", "source"), CAN)
def test_golden_frames_on_can(name: str, pgn: int, payload: str, meant: dict[str, float], source: str) -> None:
    data, made, sent = bytes.fromhex(payload), adapter_called(name, name), []
    for n in range(6):
        parts = [data] if len(data) <= 8 else [bytes([n << 5, len(data)]) + data[:6]]
        parts += [bytes([n << 5 | k + 1]) + data[6 + 7 * k : 13 + 7 * k] for k in range(4 if len(data) > 8 else 0)]
        sent += [can.Message(arbitration_id=3 << 26 | pgn << 8 | 20, data=part, timestamp=n) for part in parts]
    assert made is not None
    *_, sample = made.feed(sent)
    said = {c.name.removesuffix("_code"): v * c.scale for c, v in zip(made.channels, sample.codes, strict=True)}
    assert {key: said[key] for key in meant} == pytest.approx(meant, abs=6e-6), source


def test_golden_frames_of_a_bosch() -> None:
    made = adapter_called("bosch-mm", "bosch-mm")
    assert made is not None
    sent = [
        can.Message(
            arbitration_id=identifier, is_extended_id=False, data=bytes.fromhex(data) + bytes([n, 0]), timestamp=n
        )
        for n in range(6)
        for identifier, data, _ in BOSCH
    ]
    *_, sample = made.feed(sent)
    said = {c.name.removesuffix("_code"): v * c.scale for c, v in zip(made.channels, sample.codes, strict=True)}
    for _, _, meant in BOSCH:
        for name, value in meant.items():
            si = math.radians(value) if name.startswith("rate") else 9.80665 * value
            assert said[name] == pytest.approx(si, abs=6e-5), name


@pytest.mark.parametrize("name", ON_LINES)
def test_every_emulated_line_is_decoded_and_harm_is_counted(name: str) -> None:
    whole = [b"".join(sent) for sent in islice(stream(GYROS[name]), 400)]  # type: ignore[arg-type]
    sound = decoder(name).feed(b"".join(whole))
    assert len(sound) == 400
    damaged = list(whole)
    for victim in range(20, 400, 40):
        at = len(damaged[victim]) // 2
        damaged[victim] = damaged[victim][:at] + bytes([damaged[victim][at] ^ 4]) + damaged[victim][at + 1 :]
    damaged[201] = damaged[201][:9]  # half a frame
    wire, made, chance = b"".join(damaged), decoder(name), random.Random(3)
    heard = []
    while wire:
        cut = chance.randrange(1, 200)
        heard += made.feed(wire[:cut])
        wire = wire[cut:]
    assert 400 - 22 <= len(heard) <= 400 - 11
    assert {sample.codes for sample in heard} <= {sample.codes for sample in sound}
    assert made.crc_errors == pytest.approx(11, abs=2)


def test_every_datagram_of_a_stim_is_decoded() -> None:
    motion = Motion(5, 0.01, (1.0, -2.0, 3.0), (0.5, -0.5, 1.0), 30.0)
    for identifier in (int(one, 16) for one in protocols()["stim300"].how["frames"]):
        made = decoder("stim300")
        (sample,) = made.feed(stim(motion, identifier))
        said = {c.name.removesuffix("_code"): v * c.scale for c, v in zip(made.channels, sample.codes, strict=True)}
        assert math.degrees(said["rate_z"]) == pytest.approx(3.0), hex(identifier)
        assert said.get("acc_z", 9.80665) == said.get("incl_z", 9.80665) == pytest.approx(9.80665)
        assert (said.get("temp_x", 30), said.get("acc_temp_y", 31), said.get("incl_temp_z", 32)) == (30, 31, 32)
        assert (sample.counter, sample.latency_us) == (20, 506)


@pytest.mark.parametrize("name", list(protocols()))
def test_noise_makes_no_more_frames_than_the_checksum_lets_pass(name: str) -> None:
    size, made = 1 << 20, decoder(name)
    made.feed(random.Random(1).randbytes(size))
    begins = max(size * 2.0 ** (-8 * 1), 1.0) * (24 if name == "stim300" else 1)
    assert made.frames <= 3 * begins * ODDS[protocols()[name].check] + 3


@pytest.mark.parametrize("name", ON_LINES)
def test_many_bytes_at_once_are_as_many_pieces(name: str) -> None:
    """Whole frames, damaged and cut ones among noise: the same samples and counts."""
    chance, wire = random.Random(5), []
    for n, sent in enumerate(islice(stream(GYROS[name]), 300)):
        frame = b"".join(sent)  # type: ignore[arg-type]
        wire += [frame[: len(frame) - (n % 50 == 7)], chance.randbytes(chance.randrange(3000)) if n % 10 == 0 else b""]
    whole = b"".join(wire) + chance.randbytes(200_000)
    told = {}
    for piece in (500, len(whole)):
        made = decoder(name)
        samples = [one for at in range(0, len(whole), piece) for one in made.feed(whole[at : at + piece])]
        told[piece] = samples, made.frames, made.crc_errors, made.skipped
    assert told[500] == told[len(whole)]
    assert told[500][1] >= 290


@pytest.mark.parametrize("name", ON_CAN)
def test_every_emulated_bus_is_decoded_and_lost_cycles_leave_gaps(name: str) -> None:
    made = adapter_called(name, name)
    assert made is not None
    samples = made.feed(frames(name, 400, lost=0.02, noise=0.0))
    rates = [next(v for c, v in zip(made.channels, s.codes, strict=True) if c.name == "rate_z_code") for s in samples]
    scale = next(c.scale for c in made.channels if c.name == "rate_z_code")
    assert np.degrees(np.array(rates) * scale) == pytest.approx(10.0, abs=0.01)
    ticks = TickCounter(made.counter_size, made.rates_Hz, getattr(made, "counter_Hz", 0.0))
    numbered = ticks.number(list(samples), 1.0)
    assert ticks.sample_rate_Hz == GYROS[name].rate_Hz
    assert numbered[-1][0] == pytest.approx(395, abs=5)
    assert len(samples) == pytest.approx(388, abs=8)


def test_a_cycle_that_lacks_a_message_is_dropped() -> None:
    made = adapter_called("bosch-mm", "")
    sent = frames("bosch-mm", 100)
    del sent[3 * 50 + 1]
    assert made is not None
    assert len(made.feed(sent)) == 95
    assert made.incomplete == 1  # type: ignore[attr-defined]


SILENT = Gyro(lambda _: b"", 0.0, 1)


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("name", "baud"),
    [
        pytest.param(name, baud, marks=() if baud == GYROS[name].baud else pytest.mark.long)
        for name, protocol in protocols().items()
        for baud in protocol.bauds
    ],
)
def test_an_unknown_line_is_told_within_five_seconds(name: str, baud: int) -> None:
    begin = time.monotonic()
    with spoken(GYROS[name], baud) as path:
        found = recognised(find_port(f"serial:{path}"), "serial")
    assert (found.adapter.name, found.baud) == (name, baud)  # type: ignore[union-attr]
    assert time.monotonic() - begin < 5.0


@pytest.mark.realtime
def test_noise_and_silence_are_told_as_such() -> None:
    with (
        spoken(Gyro(lambda _: b"", 100.0, 115200), noise=b"\x00\x55noise" * 9) as path,
        pytest.raises(LinkError) as told,
    ):
        recognised(find_port(f"serial:{path}"), "serial:x")
    assert "bytes were heard at" in str(told.value)
    assert "no frame of stim300" in str(told.value)
    with spoken(SILENT) as path, pytest.raises(LinkError, match="nothing was heard in 2 s; check supply and wiring"):
        recognised(find_port(f"serial:{path}"), "serial:x")


@pytest.mark.realtime
@pytest.mark.parametrize("name", ON_CAN)
def test_an_unknown_bus_is_told_and_recorded(tmp_path: Path, name: str) -> None:
    over, due = threading.Event(), 1.0 / GYROS[name].rate_Hz

    def speak() -> None:
        with can.Bus(name, interface="virtual", protocol=can.CanProtocol.CAN_FD) as bus:
            for sent in stream(GYROS[name]):
                for one in sent:
                    bus.send(one)  # type: ignore[arg-type]
                if over.wait(due):
                    return

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        run = hil.record(f"can:virtual:{name}", duration_s=1.0, out=tmp_path, report=False)
    finally:
        over.set()
        thread.join()
    assert run.path.name.endswith(name)
    assert np.degrees(rates_rad_s(read_capture(run.path / "capture.arrow"))["z"].mean()) == pytest.approx(
        10.0, abs=0.05
    )


def test_a_file_of_bytes_is_recognised_and_recorded(tmp_path: Path) -> None:
    for name, query in (("xsens", "?rate=100"), ("vn100", "")):
        file = tmp_path / f"{name}.bin"
        file.write_bytes(b"".join(one for sent in islice(stream(GYROS[name]), 300) for one in sent))  # type: ignore[misc]
        run = hil.record(f"replay:{file}{query}", out=tmp_path / "runs", report=False)
        capture = read_capture(run.path / "capture.arrow")
        assert (run.verdict, run.result.samples, capture.tick_rate_Hz) == ("good", 300, 100.0)
        assert {"acc_z_code", "temp_code"} <= set(capture.columns)


@pytest.mark.parametrize(
    ("link", "dbc", "said"),
    [
        ("can:virtual:none", None, "no frame in 4.5 s; check bit rate, termination and supply"),
        ("can:virtual:none", "absent.dbc", "absent.dbc: No such file"),
        ("can:virtual:none", "broken.dbc", "broken.dbc: no DBC that can be read"),
        ("can:virtual:none", "rateless.dbc", "rateless.dbc: none of its 1 messages has an angular rate"),
        ("serial:/dev/null", "rateless.dbc", "beside no CAN bus"),
        ("replay:empty.bin", None, "empty.bin: is empty"),
        ("replay:empty.bin?rate=fast", None, "bad option; expected replay:FILE"),
        ("replay:absent.bin", None, "absent.bin: No such file"),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, link: str, dbc: str | None, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.dbc").write_text("this is no DBC\n")
    Path("rateless.dbc").write_text('BO_ 1 A: 8 X\n SG_ t : 0|8@1+ (1,0) [0|1] "degC" X\n')
    Path("empty.bin").write_bytes(b"")
    with pytest.raises((InputError, LinkError)) as told:
        hil.record(link, dbc=dbc, out=tmp_path / "runs")
    assert said in str(told.value)
    assert "\n" not in str(told.value)


def test_the_command_line_takes_a_dbc(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["record", "can:virtual:none", "--dbc", str(tmp_path / "none.dbc"), "--out", str(tmp_path)]
    assert cli.execute(arguments) == 2
    assert "none.dbc: No such file" in capfd.readouterr().err
