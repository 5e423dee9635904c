"""Logs of CAN frames by a DBC: every format, several sensors at once, a true rate, slips of scale, what is no log."""

import math
from collections.abc import Sequence
from pathlib import Path

import can
import numpy as np
import pytest

import hil
from device_emulator.gyros import Motion, bosch_mm, furuno, j1939, nmea2000
from hil import cli
from hil.errors import InputError
from hil.importing.can_log import slips
from hil.records.capture import read_capture
from hil.records.rates import rates_rad_s
from hil.sensors.can_decoder import declared_decoder

SENSORS = Path(__file__).parents[2] / "hil" / "sensors" / "dbc"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Captures are written where one is."""
    monkeypatch.chdir(tmp_path)


def turning(n: int) -> float:
    return 30.0 * math.sin(0.02 * n)


def logged(samples: int = 600, scale: float = 1.0) -> list[can.Message]:
    """Two sensors on one turning table at 100 Hz, the second with its scale."""
    made = []
    for n in range(samples):
        first = Motion(n, 0.01 * n, (1.0, 2.0, turning(n)))
        second = first._replace(rate=(1.0, 2.0, scale * turning(n)))
        for one in (*bosch_mm(first), *j1939(second)):
            one.timestamp = 1.7e9 + 0.01 * n
            made.append(one)
    return made


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    """Both sensors, in the words of a maker."""
    first = (SENSORS / "bosch_mm.dbc").read_text().replace("rate_z", "YawRate")
    second = (SENSORS / "j1939.dbc").read_text().partition("BU_: IMU\n")[2].replace("rate_z", "Truth")
    (tmp_path / "car.dbc").write_text(first + second)
    return tmp_path / "car.dbc"


def written(path: Path, frames: Sequence[can.Message]) -> Path:
    with can.Logger(str(path)) as log:
        for frame in frames:
            log(frame)
    return path


def by_asammdf(path: Path, frames: Sequence[can.Message]) -> Path:
    """A bus log of MDF 4.10 as asammdf itself writes one; python-can is not asked."""
    mdf = pytest.importorskip("asammdf", reason="the extra `mf4` is not installed")
    from asammdf.blocks import v4_constants
    from asammdf.blocks.v4_blocks import SourceInformation

    named = {"BusChannel": "u1", "ID": "<u4", "IDE": "u1", "DLC": "u1", "DataLength": "u1", "DataBytes": "(8,)u1"}
    rows = np.zeros(len(frames), [(f"CAN_DataFrame.{name}", kind) for name, kind in named.items()])
    for number, one in enumerate(frames):
        data = np.frombuffer(bytes(one.data).ljust(8, b"\0"), np.uint8)
        rows[number] = (0, one.arbitration_id, one.is_extended_id, one.dlc, one.dlc, data)
    times = np.array([one.timestamp - frames[0].timestamp for one in frames])
    bus = SourceInformation(source_type=v4_constants.SOURCE_BUS, bus_type=v4_constants.BUS_TYPE_CAN)
    with mdf.MDF(version="4.10") as log:
        log.append(mdf.Signal(samples=rows, timestamps=times, name="CAN_DataFrame", source=bus))
        log.save(path)
    return path


def test_an_mf4_without_its_end_or_without_a_bus_is_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = by_asammdf(tmp_path / "a.mf4", logged(60)).read_bytes()
    (tmp_path / "cut.mf4").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "old.mf4").write_bytes(b"MDF     3.30    " + bytes(300))
    by_asammdf(tmp_path / "none.mf4", [])
    for name, said in (("cut", "that can be read"), ("old", "MDF 4 with a whole header"), ("none", "no frame in it")):
        assert cli.execute(["import", f"{name}.mf4", "--dbc", "j1939"]) == 2
        told = capfd.readouterr().err
        assert said in told
        assert told.count("\n") == 1, told


@pytest.mark.parametrize("ending", ["log", "blf", "asc", "trc", "mf4"])
def test_every_format_becomes_the_same_rates(tmp_path: Path, dbc: Path, ending: str) -> None:
    write = by_asammdf if ending == "mf4" else written
    made = hil.import_record(write(tmp_path / f"a.{ending}", logged()), dbc=dbc, reference="Truth")
    rates = rates_rad_s(made.capture)
    expected = np.radians([turning(n) for n in range(600)])
    assert rates["yawrate"] == pytest.approx(expected, abs=np.radians(0.003))
    assert made.capture.rate_rad_s == pytest.approx(expected, abs=np.radians(0.005))
    assert made.capture.tick_rate_Hz == pytest.approx(100.0, rel=1e-4)
    assert (made.of_rows, made.capture.lost) == (3000, 0)
    assert not [remark for remark in made.said if "times" in remark]


@pytest.mark.parametrize(
    ("scale", "words"),
    [(0.5, "half"), (2.0, "double"), (math.pi / 180.0 * 4, None), (-1.0, "the sign"), (0.8, None), (1.0, None)],
)
def test_a_wrong_scale_between_two_sensors_is_named(tmp_path: Path, dbc: Path, scale: float, words: str | None) -> None:
    file = written(tmp_path / "a.log", logged(scale=scale))
    remarks = hil.import_record(file, dbc=dbc).said
    named = [remark for remark in remarks if " times " in remark]
    assert len(named) == (words is not None)
    assert words is None or words in named[0]


def test_degrees_for_radians_are_named_and_unlike_rates_are_not() -> None:
    turn, noise = np.sin(np.arange(500) / 20.0), np.random.default_rng(1).standard_normal(500)
    (said,) = slips({"a": turn, "b": turn * math.pi / 180.0}, None)
    assert said.startswith("b is 0.01745 times a: π/180")
    assert not list(slips({"a": turn, "b": noise, "c": np.zeros(500)}, "a"))


def test_a_lost_frame_leaves_a_gap_and_senders_are_kept_apart(tmp_path: Path) -> None:
    frames = []
    for n in range(300):
        (one,) = nmea2000(Motion(n, 0.1 * n, (0.0, 0.0, 5.0)))
        for source, n_of in ((0x34, 1), (0x51, 2)):
            if n % n_of == 0 and not 100 <= n < 103:
                again = can.Message(arbitration_id=one.arbitration_id & ~0xFF | source, data=one.data)
                again.timestamp = 10.0 + 0.1 * n
                frames.append(again)
    capture = hil.import_record(written(tmp_path / "n.log", frames), dbc="nmea2000").capture
    assert (len(capture), capture.lost, capture.gaps) == (297, 3, 1)
    assert sorted(rates_rad_s(capture)) == ["z_34", "z_51"]


def test_texts_of_other_loggers(tmp_path: Path) -> None:
    """Lines as candump's screen, canboat and a gateway write them; the values are those of canboat's page."""
    screen = [f" ({10 + 0.1 * n:.6f})  can0  09F11334   [8]  00 1A 8E FF FF 27 02 FF" for n in range(9)]
    raw = [f"2026-08-03T03:19:4{n}.801Z,3,127251,27,255,8,00,1a,8e,ff,ff,27,02,ff" for n in range(9)]
    gateway = [f"00:29:5{n}.617 R 09F1130D 00 1A 8E FF FF 27 02 FF" for n in range(9)]
    for number, lines in enumerate((screen, ["# format=FAST", *raw], gateway)):
        file = tmp_path / f"{number}.txt"
        file.write_text("\n".join(lines) + "\n")
        capture = hil.import_record(file, dbc="nmea2000").capture
        assert rates_rad_s(capture)["z"] == pytest.approx([-0.00091119] * 9, abs=1e-8)
    payload = "3f,9f,59,ff,ff,ff,27,00,00,00,3f,00,00,00,00,f8,ff,ff,ff,f7,02,00,00,0e,e1,ff,ff,00,00"
    whole = "".join(f"2026-08-03T03:21:2{n}.245Z,7,130842,52,255,29,{payload}\n" for n in range(9))
    (tmp_path / "six.raw").write_text(whole)
    capture = hil.import_record(tmp_path / "six.raw", dbc="furuno").capture
    assert rates_rad_s(capture)["z"] == pytest.approx([-0.13827] * 9, abs=6e-6)


def test_stamps_that_are_bunched_or_none_are_told(tmp_path: Path) -> None:
    lines = [f"({10 + 0.1 * (n // 5 * 5) + 0.001 * (n % 5):.6f}) can0 09F11334#001A8EFFFF2702FF" for n in range(200)]
    (tmp_path / "b.log").write_text("\n".join(lines))
    made = hil.import_record(tmp_path / "b.log", dbc="nmea2000")
    assert "came in bunches (1 ms apart by median" in made.said[0]
    assert (made.capture.lost, len(made.capture)) == (0, 200)
    (tmp_path / "c.log").write_text("\n".join(["(10.000000) can0 09F11334#001A8EFFFF2702FF"] * 50))
    with pytest.raises(InputError, match=r"c\.log: rate_z: most of its 50 stamps repeat"):
        hil.import_record(tmp_path / "c.log", dbc="nmea2000")


def test_a_stamp_that_came_late_is_no_gap(tmp_path: Path) -> None:
    """Every 20th is late by more than a sample, and the next comes at once; of three others nothing came."""
    lines = []
    for n in range(600):
        late_s = 0.0113 if n % 20 == 9 else 0.0012 if n % 20 == 10 else 0.0
        if n not in (203, 204, 405):
            lines.append(f"({10 + 0.01 * n + late_s:.6f}) can0 09F11334#001A8EFFFF2702FF")
    (tmp_path / "late.log").write_text("\n".join(lines))
    capture = hil.import_record(tmp_path / "late.log", dbc="nmea2000").capture
    assert (len(capture), capture.lost, capture.gaps) == (597, 3, 2)
    assert capture.tick.tolist() == [n for n in range(600) if n not in (203, 204, 405)]
    assert capture.tick_rate_Hz == pytest.approx(100.0, rel=2e-3)


def test_messages_of_one_name_are_kept_apart(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """As a maker's DBC of two versions of a device has them."""
    two = "".join(f'BO_ {k} imu: 8 X\n SG_ RateZ : 0|16@1- ({f},0) [0|1] "deg/s" X\n' for k, f in ((9, 1), (25, 0.5)))
    (tmp_path / "two.dbc").write_text(f'VERSION ""\nBU_: X\n{two}')
    (tmp_path / "n.log").write_text("\n".join(f"({10 + 0.1 * n:.6f}) can0 019#0600000000000000" for n in range(50)))
    assert cli.execute(["import", str(tmp_path / "n.log"), "--dbc", str(tmp_path / "two.dbc"), "-o", "n.arrow"]) == 0
    assert "Overwriting" not in capfd.readouterr().err
    rates = rates_rad_s(read_capture(Path("n.arrow")))
    assert [np.degrees(rate).mean() for rate in rates.values()] == pytest.approx([3.0])


def test_whole_fast_packets_of_an_emulated_furuno(tmp_path: Path) -> None:
    frames = [one for n in range(60) for one in furuno(Motion(n, 0.1 * n, (1.0, 2.0, 3.0)))]
    for n, one in enumerate(frames):
        one.timestamp = 0.02 * n + 1.0
    rates = rates_rad_s(hil.import_record(written(tmp_path / "f.log", frames), dbc="furuno").capture)
    assert [np.degrees(rates[axis].mean()) for axis in "xyz"] == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("name", "given", "said"),
    [
        ("a.log", {}, "a.log: a log of CAN frames; say what they are by --dbc FILE|dbc="),
        ("a.log", {"dbc": "absent.dbc"}, "absent.dbc: No such file"),
        ("a.log", {"dbc": "broken.dbc"}, "broken.dbc: no DBC that can be read"),
        ("a.log", {"dbc": "furuno"}, r"none of its 3000 frames is in furuno; its identifiers are 0x174"),
        (
            "a.log",
            {"dbc": "j1939", "reference": "Yaw"},
            "no rate .Yaw. for .*reference.*; it has rate_y, rate_x",
        ),
        ("empty.log", {"dbc": "j1939"}, "empty.log: no frame in it"),
        ("cut.blf", {"dbc": "j1939"}, "cut.blf: no log of CAN frames that can be read"),
        ("a.mf4", {"dbc": "j1939"}, r"a.mf4: MF4 needs the package asammdf|a.mf4: no log of CAN frames"),
        ("absent.log", {"dbc": "j1939"}, "absent.log: No such file"),
        ("untimed.log", {"dbc": "nmea2000"}, "line 1: times are missing; record with candump -l"),
        ("a.log", {"reference": "rate_z"}, "reference.*without a DBC; give --dbc|dbc="),
    ],
)
def test_bad_input_is_one_line(name: str, given: dict[str, str], said: str) -> None:
    written(Path("a.log"), logged())
    Path("broken.dbc").write_text("this is no DBC\n")
    Path("empty.log").write_text("")
    Path("cut.blf").write_bytes(b"LOGG\x00\x01")
    Path("a.mf4").write_bytes(b"MDF     4.10    ")
    Path("untimed.log").write_text("  can0  09F11334   [8]  00 1A 8E FF FF 27 02 FF\n")
    with pytest.raises(InputError, match=said) as told:
        hil.import_record(name, out="x.arrow", **given)  # type: ignore[arg-type]
    assert "\n" not in str(told.value)
    assert not Path("x.arrow").exists()


def test_the_command_line(tmp_path: Path, capfd: pytest.CaptureFixture[str], dbc: Path) -> None:
    file = written(tmp_path / "a.blf", logged(scale=0.5))
    assert cli.execute(["import", str(file), "--dbc", str(dbc), "--reference", "YawRate"]) == 0
    told = "".join(capfd.readouterr())
    assert "600 samples of 3000 rows at 100 Hz, rates" in told
    assert "is 0.5 times" in told
    assert declared_decoder("j1939").title.startswith("J1939")
