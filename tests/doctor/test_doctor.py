"""`hil doctor`: findings with one-line remedies, a link measured, and no link that is down taken for a silent board."""

import json
import os
import resource
from pathlib import Path
from typing import Any

import pytest

from hil import cli
from hil.doctor import link, machine
from hil.doctor.link import capacity, wire_rate_Hz
from hil.doctor.machine import Finding

PROBED: dict[str, Any] = {
    "identity": {"unique_id": 7, "tick_rate_Hz": 4000.0, "latency_ticks": 1, "capabilities": 1 | 2},
    "round_trip_us": {"p50": 40.0, "p99": 90.0, "max": 300.0},
    "wake_up_us": {"p50": 5.0, "p99": 20.0, "max": 80.0},
    "refused": [],
    "streaming": False,
    "tick_us": {"p50": 5.0, "p99": 10.0, "max": 30.0},
    "block_us_per_row": 2.0,
}


def test_every_finding_is_a_line_and_what_is_missing_has_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    monkeypatch.setattr(resource, "getrlimit", lambda _: (8 << 20, 8 << 20))
    monkeypatch.setattr(machine, "AWAKE", Path(os.devnull))
    monkeypatch.setattr("hil.wire.framing.COBS_IN_C", False)
    found = list(machine.examine())
    assert len(found) == 6
    for finding in found:
        assert finding.state == "missing"
        assert finding.remedy
        assert "\n" not in finding.told + finding.remedy


def test_a_fit_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None)
    monkeypatch.setattr(os, "access", lambda *_: True)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3})
    monkeypatch.setattr(os, "getloadavg", lambda: (0.2, 0.2, 0.2))
    monkeypatch.setattr("hil.wire.framing.COBS_IN_C", True)
    monkeypatch.setattr("hil.running.process.line_workers.line_workers", lambda: [os.getpid()])
    assert [finding.state for finding in machine.examine()] == ["good"] * 6


def test_what_a_board_in_qemu_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda command: f"/usr/bin/{command}")
    assert [finding.state for finding in machine.examine_target()] == ["good"] * 2
    monkeypatch.setattr("shutil.which", lambda _: None)
    compiler, emulator = machine.examine_target()
    assert compiler.remedy == "sudo apt install gcc-arm-none-eabi libnewlib-arm-none-eabi"
    assert emulator.remedy == "sudo apt install qemu-system-arm"


def test_a_port_without_permission_and_a_slow_adapter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch()
    monkeypatch.setattr(machine, "USB_SERIAL", tmp_path / "usb-serial")
    timer = tmp_path / "usb-serial" / "ttyUSB0" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    monkeypatch.setattr(os, "access", lambda *_: False)
    closed, slow = machine.serial_port(str(port))
    assert (closed.state, closed.told) == ("bad", "no permission")
    assert closed.remedy == f"sudo usermod -aG {port.group()} $USER, then log in again"
    assert slow.told == "the adapter holds bytes back for up to 16 ms"
    assert slow.remedy == f"echo 1 | sudo tee {timer}"
    timer.write_text("1\n")
    monkeypatch.setattr(os, "access", lambda *_: True)
    assert [finding.state for finding in machine.serial_port(str(port))] == ["good"]


REAL = {"info_kind": "can", "info_data": {"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 1000000}}}
FAST = {"data_bittiming": {"bitrate": 8000000}}


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        (
            {"flags": ["NOARP"], "mtu": 72, "linkinfo": REAL},
            (
                "can0", "bad", "the interface is down",
                "sudo ip link set can0 up type can bitrate 1000000 dbitrate 8000000 fd on",
            ),
        ),
        (
            {"flags": ["UP"], "mtu": 16, "linkinfo": {"info_kind": "vcan"}},
            ("can0", "bad", "no CAN FD", "sudo ip link set can0 down && sudo ip link set can0 mtu 72 up"),
        ),
        (
            {"flags": ["UP"], "mtu": 72, "linkinfo": {"info_kind": "can", "info_data": {"state": "BUS-OFF"}}},
            (
                "can0", "bad", "the controller is in BUS-OFF",
                "check wiring, termination and bit timing, then sudo ip link set can0 type can restart",
            ),
        ),
        (
            {"flags": ["UP"], "mtu": 72, "linkinfo": {"info_kind": "can", "info_data": REAL["info_data"] | FAST}},
            ("can0", "good", "up, 1 Mbit/s and 8 Mbit/s", ""),
        ),
        ({"flags": ["UP"], "mtu": 72, "linkinfo": {"info_kind": "vcan"}}, ("can0", "good", "up, virtual", "")),
    ],
)  # fmt: skip
def test_can_interfaces(told: dict[str, Any], expected: tuple[str, ...]) -> None:
    """As `ip -json -details link show` describes them."""
    assert machine.can_interface("can0", told) == expected


def test_what_a_wire_carries() -> None:
    """A row is four codes of two bytes. At 1/8 Mbit/s a CAN FD frame of seven rows takes 105 µs."""
    assert wire_rate_Hz(921_600, None) == pytest.approx(92160 / 8 / 1.08)
    assert wire_rate_Hz(None, (1e6, 8e6)) == pytest.approx(7 / 105e-6)
    assert wire_rate_Hz(None, None) == float("inf")


def test_the_rate_that_can_be_held() -> None:
    held = capacity(PROBED)
    assert held.force_Hz == pytest.approx(1e6 / (90 + 10))
    assert held.gain_Hz == pytest.approx(0.5 * 1e6 / (1.2 * 2.0))
    assert capacity(PROBED, baud=921_600).gain_Hz == pytest.approx(92160 / 8 / 1.08)
    later = PROBED | {"identity": PROBED["identity"] | {"latency_ticks": 3}}
    assert capacity(later).force_Hz == pytest.approx(3e6 / 100)


def test_a_board_that_is_too_fast_is_told_what_to_do() -> None:
    fast = PROBED | {"identity": PROBED["identity"] | {"tick_rate_Hz": 100_000.0}}
    found = {finding.subject: finding for finding in link.judge("can:can0", fast, capacity(fast))}
    assert found["force mode"].state == "missing"
    assert found["force mode"].told.startswith("up to 10000 Hz (round trip 90 µs and observer 10 µs, p99")
    assert 'mode = "gain"' in found["force mode"].remedy
    assert found["gain mode"] == Finding(
        "gain mode",
        "good",
        "up to 200000 Hz (the observer takes 2 µs a sample, the host 1.2 times that, 50% of a core)",
    )


@pytest.mark.parametrize(("rate", "told"), [(249_999.0, 240_000.0), (10_666.0, 10_000.0), (97.0, 97.0)])
def test_rates_are_rounded_down(rate: float, told: float) -> None:
    assert link.rounded(rate) == told


@pytest.mark.parametrize(
    ("url", "baud"),
    [
        ("serial:/dev/ttyUSB0", 3e6),
        ("serial:/dev/ttyUSB0?baud=921600", 921600.0),
        ("serial:/dev/ttyACM0", None),
        ("serial:/dev/pts/4", None),
        ("can:can0", None),
    ],
)
def test_only_a_real_uart_has_a_baud_rate(url: str, baud: float | None) -> None:
    assert link.uart_baud(url) == baud


def test_an_interface_that_is_down_is_not_a_silent_board(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the link says when it is opened comes through with its remedy, not as a board that does not answer."""
    said = "can:can0: can0 is down: sudo ip link set can0 up type can bitrate 1000000 dbitrate 8000000 fd on"

    class Said:
        stdout = json.dumps({"error": said})
        returncode = 2

    monkeypatch.setattr("hil.doctor.link.subprocess.run", lambda *_, **__: Said())
    (finding,), measured = link.examine("can:can0")
    assert measured is None
    assert finding.state == "bad"
    assert finding.told == "can0 is down"
    assert finding.remedy == "sudo ip link set can0 up type can bitrate 1000000 dbitrate 8000000 fd on"


@pytest.mark.slow
def test_a_link_that_is_not_there_fails(capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.execute(["doctor", "--link", "serial:/dev/ttyUSB77", "--json"]) == 1
    told = json.loads(capfd.readouterr().out)
    assert told["measured"] is None
    assert told["findings"][-1]["state"] == "bad"
    assert "no such port" in told["findings"][-1]["told"]
    assert cli.execute(["doctor", "--link", "pty:nowhere"]) == 2


@pytest.mark.slow
@pytest.mark.realtime
def test_a_link_is_measured(capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.execute(["doctor", "--link", "pty:s-slow", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    measured = told["measured"]
    assert measured["identity"]["unique_id"] == 0x5107
    assert measured["streaming"] is True
    trip = measured["round_trip_us"]
    assert 0 < trip["p50"] <= trip["p99"] <= trip["max"]
    assert {finding["subject"] for finding in told["findings"]} >= {"link", "round trip", "force mode", "gain mode"}
