"""Board mode and ESTIMATE: the C board that closes its own loop, beside the host that permits it to and watches."""

import ctypes
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.bench import Bench, load_bench, override
from hil.comparing.course import Judge, Reference
from hil.comparing.own_loop import board_course
from hil.errors import InputError
from hil.exporting.exported import tables_of
from hil.progress import untold
from hil.records.check import check
from hil.records.layout import TICK, Column, Layout
from hil.records.runfolder import RunFolder
from hil.records.units import unit_of
from hil.report.page import render
from hil.running.recording.recorder import record_here
from hil.running.request import RunRequest
from hil.running.run import run
from hil.scoring.score import score
from hil.testing.board_rules.served import Board as UdpBoard
from hil.wire import client
from hil.wire.can_format import HOST, CanFormat
from hil.wire.key_file import make_key
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    DriveBoard,
    Estimate,
    EstimatedEntries,
    EstimateFlags,
    Hello,
    LoopMode,
    Message,
    NackReason,
    Safe,
    SafeReason,
    State,
    Status,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter

from .c_board import CBoard
from .c_messages import struct_of
from .process import Host, pty_board, refused, write

EXAMPLES = Path(__file__).parents[2] / "examples"
RATE_RAD_S = 1.0
SETTLE_S = 2.0


def declared(**loop: Any) -> Bench:
    """The C board's bench in board mode: no virtual rotation and no dither, as its estimator has neither."""
    bench = load_bench(EXAMPLES / "c-board.bench.toml")
    keys = {"mode": "board", "block": 40, "duration_s": 4.0, "settle_s": SETTLE_S, **loop}
    still = {"virtual_rotation_rad_s": 0.0, "dither_mps2": 0.0}
    return override(bench, {"loop": keys, "link": {"watchdog_s": 0.05}, "controller": still}, "test")


def ran(built: Path, place: Path, bench: Bench, *options: str) -> RunFolder:
    """The folder of a run with the example board."""
    with pty_board(built, "--estimator", "--rate", str(RATE_RAD_S), *options) as (_, url):
        done = run(RunRequest(bench, url), place, report=False, progress=untold)
    assert done.folder is not None
    return RunFolder(done.folder)


@pytest.fixture(scope="module")
def folder(built: Path, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A run in lockstep that went well."""
    return ran(built, tmp_path_factory.mktemp("board-mode"), declared())


# ---------------------------------------------------------------------------------------------------------- whole runs


@pytest.mark.slow
def test_a_run_in_board_mode_is_good_and_its_estimates_are_right(folder: RunFolder) -> None:
    result, board, host = folder.result, folder.board_estimates, folder.estimates
    assert result is not None
    assert board is not None
    assert host is not None
    assert (result.verdict, result.reasons, result.lost, result.mode) == ("good", (), 0, "board")
    assert result.parts["machine"].reason.endswith("samples recorded; the board drove by itself")
    assert result.counters["estimates"] == len(board) == 4 * 4000 // 40
    assert not folder.timing_path.exists()  # no sample was answered
    np.testing.assert_array_equal(board.tick, host.tick)
    scored = board.t_s >= SETTLE_S
    for estimates in (board, host):
        slope = np.polyfit(estimates.t_s[scored], estimates["angle_rad"][scored], 1)[0]
        assert slope == pytest.approx(RATE_RAD_S, abs=0.05)
    assert np.median(board["rate_rad_s"][scored]) == pytest.approx(RATE_RAD_S, abs=0.1)
    assert board["angle_rad"][scored][0] == 0.0  # counts from the host's zero
    # It drives as of the sample at which the host's observer had acquired the motion, not before.
    driving = board["driving"].astype(bool)
    assert not driving[0]
    assert driving[-1]


@pytest.mark.slow
def test_its_table_has_names_and_units(folder: RunFolder) -> None:
    board = folder.board_estimates
    assert board is not None
    units = {name: board.unit(name) for name in board.states}
    assert units["x_m"] == "m"
    assert units["phi_x_V"] == "V"
    assert units["rate_rad_s"] == "rad/s"
    assert units["kxx_per_s2"] == "1/s²"
    assert len(units) == 13
    (table,) = tables_of(folder.path, ("board_estimates",))
    assert (table.rows, table.units["sd_x_m"], table.units["angle_rad"]) == (len(board), "m", "rad")
    assert "board_estimates" in [one.name for one in tables_of(folder.path, ())]
    checked = {one.name: one for one in check(folder.path)}
    assert checked["board_estimates.arrow"].problems == []


@pytest.mark.slow
def test_it_is_summed_up_beside_the_hosts(folder: RunFolder) -> None:
    result = folder.result
    assert result is not None
    found = result.board
    assert found is not None
    board, host = folder.board_estimates, folder.estimates
    assert board is not None
    assert host is not None
    scored = board.t_s >= SETTLE_S
    difference = (board["angle_rad"] - host["angle_rad"])[scored]
    assert found.angle_difference_rms_rad == pytest.approx(np.sqrt(np.mean((difference - difference[0]) ** 2)))
    assert found.angle_difference_rms_rad < 0.1
    assert found.rows == len(board)


@pytest.mark.slow
def test_it_is_a_row_of_the_comparison(folder: RunFolder) -> None:
    course = board_course(folder)
    assert course is not None
    assert course.name == "on the board"
    tick = course.tick
    truth = Reference("truth", tick, RATE_RAD_S * tick / 4000.0, np.full(tick.size, RATE_RAD_S))
    row = Judge(4000.0, SETTLE_S, 1.5791e6).row(course, truth)
    assert row.angle_error_rms_rad is not None
    assert row.angle_error_rms_rad < 0.1
    assert row.rate_error_rms_rad_s == pytest.approx(np.sqrt(np.mean((course.rate[tick >= 8000] - 1.0) ** 2)))
    assert row.stiffness_error is None  # it declares its constants, and estimates none
    assert board_course(RunFolder(folder.path.parent)) is None


@pytest.mark.slow
def test_it_is_scored_and_reported(folder: RunFolder, tmp_path: Path) -> None:
    names = ("x_m", "vx_mps", "phi_x_V", "rate_rad_s", "angle_rad")
    header = {"stiffness_per_s2": [1.602e6], "damping_per_s": [1.5], "sample_rate_Hz": 4000.0, "tick_rate_Hz": 4000.0}
    layout = Layout("truth", (TICK, *(Column(name, "f8", unit_of(name)) for name in names)), 1000, header)
    with record_here(tmp_path, {"truth": layout}) as recording:
        for tick in range(39, 16000, 40):
            recording["truth"].put(tick, 0.0, 0.0, 6e-3, RATE_RAD_S, RATE_RAD_S * tick / 4000.0)
    result = score(folder.path, tmp_path / "truth.arrow")
    assert result.board is not None
    assert result.board.score is not None
    board = folder.board_estimates
    assert board is not None
    scored = board.t_s >= SETTLE_S
    error = (board["angle_rad"] - RATE_RAD_S * board.t_s)[scored]
    assert result.board.angle_error_rms_rad == pytest.approx(np.sqrt(np.mean((error - error[0]) ** 2)), rel=1e-6)
    assert result.board.score.coverage == {}  # it says no deviations
    page = render(RunFolder(folder.path))
    assert "On the board: 400 estimates of its own" in page
    assert "less the true rotation" in page


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (
            "2.5:nan",
            "the board's own estimate at tick 10039: rate is nan, which is no number; correct the board's estimator",
        ),
        (
            "2.5:1e9",
            "rate is 1e+09 rad/s, out of -1256.62 to 1256.62 for the declared device; correct the board's estimator",
        ),
    ],
)
def test_an_estimate_that_cannot_be_ends_in_safe_with_one_line(
    built: Path, tmp_path: Path, wrong: str, told: str
) -> None:
    folder = ran(built, tmp_path, declared(), "--wrong", wrong)
    result = folder.result
    assert result is not None
    assert any(told in reason for reason in result.reasons), result.reasons
    assert all("\n" not in reason for reason in result.reasons)
    assert result.verdict == "interrupted"
    assert result.parts["safety"].outcome == "failed"  # "unsafe" where SAFE was not confirmed
    assert folder.capture is not None
    assert len(folder.capture) <= 10_100  # it did not go on


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_a_board_without_an_estimator_is_refused_in_one_line(built: Path, tmp_path: Path) -> None:
    with pty_board(built) as (_, url), pytest.raises(InputError) as refusal:
        run(RunRequest(declared(), url), tmp_path, progress=untold)
    assert str(refusal.value).endswith('the board has no estimator of its own; use [loop] mode = "force"')


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.usefixtures("no_report")
def test_on_the_boards_own_clock(built: Path, tmp_path: Path) -> None:
    folder = ran(built, tmp_path, declared(clock="paced", block=40))
    result = folder.result
    assert result is not None
    assert result.board is not None
    assert result.board.rows > 0
    assert result.parts["safety"].outcome == "good"


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_over_keyed_udp(built: Path, tmp_path: Path) -> None:
    key = tmp_path / "board.key"
    make_key(key)
    board = UdpBoard([str(built / "udp_board"), "239.255.42.68:42686", str(key), "127.0.0.1", "--estimator"])
    try:
        done = run(RunRequest(declared(), board.url), tmp_path, report=False, progress=untold)
    finally:
        board.end()
    assert done.folder is not None
    result = RunFolder(done.folder).result
    assert result is not None
    assert result.verdict == "good"
    assert result.counters["estimates"] in (399, 400)  # the last may come when the last sample has ended the run


# ------------------------------------------------------------------------------------------------------ what it does


@pytest.fixture
def host(built: Path) -> Iterator[Host]:
    """A host that has greeted the example board with its estimator, in lockstep."""
    with pty_board(built, "--estimator") as (_, url):
        host = Host(url)
        yield host
        host.close()


def armed(host: Host, clock: ClockMode = ClockMode.LOCKSTEP, **registers: float) -> None:
    host.set("CLOCK_MODE", clock)
    host.set("LOOP_MODE", LoopMode.BOARD)
    for name, value in registers.items():
        host.set(name, value)
    host.endpoint.send(Arm())


def until(host: Host, kind: type[Message], count: int = 1) -> list[Message]:
    """What it says up to the given number of messages of a kind."""
    heard: list[Message] = []
    while sum(isinstance(message, kind) for message in heard) < count:
        heard += host.hear()
    return heard


def test_it_names_what_it_can(host: Host) -> None:
    able = Capabilities(host.identity.capabilities)
    assert Capabilities.BOARD_MODE in able
    assert Capabilities.ESTIMATE in able
    assert host.set("ESTIMATE_EVERY", 8) == 8
    assert client.read_register(host.endpoint, "ESTIMATE_EVERY") == 8


def test_nothing_drives_before_it_is_permitted(host: Host) -> None:
    armed(host, BLOCK=40)
    until(host, Sense)
    for _ in range(10):
        host.endpoint.send(DriveBoard(0))
        (sense,) = [message for message in until(host, Sense) if isinstance(message, Sense)]
        assert not sense.codes[:, 2:].any()
    for _ in range(10):
        host.endpoint.send(DriveBoard(1))
        (sense,) = [message for message in until(host, Sense) if isinstance(message, Sense)]
    assert sense.codes[:, 2:].any()
    host.endpoint.send(DriveBoard(0))
    host.endpoint.send(DriveBoard(0))
    *_, last = [message for message in until(host, Sense, 2) if isinstance(message, Sense)]
    assert not last.codes[-30:, 2:].any()


def test_a_permission_that_is_neither_yes_nor_no_is_refused(host: Host) -> None:
    assert refused(host.say(DriveBoard(1))) is NackReason.BAD_STATE
    armed(host)
    until(host, Sense)
    assert refused(host.say(DriveBoard(2))) is NackReason.OUT_OF_RANGE


@pytest.mark.parametrize("lost", [True, False])
def test_a_host_that_is_gone_ends_in_safe_within_the_watchdog(host: Host, lost: bool) -> None:
    """The board's own estimator drives on wall time; no permission comes any more, or one keeps coming."""
    armed(host, ClockMode.PACED, BLOCK=40, WATCHDOG_TICKS=200)
    until(host, Sense)
    host.endpoint.send(DriveBoard(1))
    (running,) = [m for m in until(host, Status) if isinstance(m, Status) and m.state == State.RUNNING]
    heard: list[Message] = []
    deadline = time.monotonic() + 0.4
    while time.monotonic() < deadline:
        if not lost:
            host.endpoint.send(DriveBoard(1))
        heard += [item.message for item in host.endpoint.poll(0.01)]
    stops = [m for m in heard if isinstance(m, Status) and m.state == State.SAFE]
    if not lost:
        assert not stops
        return
    (stop,) = stops
    assert stop.reason == SafeReason.WATCHDOG
    assert stop.tick - running.tick <= 200 + 40 + 1


def test_the_estimates_come_at_their_stride_with_their_tick(host: Host) -> None:
    armed(host, BLOCK=40, ESTIMATE_EVERY=16)
    heard = until(host, Sense)
    for _ in range(8):
        host.endpoint.send(DriveBoard(1))
        heard += until(host, Sense)
    ticks = [message.tick for message in heard if isinstance(message, Estimate)]
    assert ticks[:10] == [15 + 16 * k for k in range(10)]
    newest = [message for message in heard if isinstance(message, Estimate)][-1]
    assert EstimatedEntries.RATE | EstimatedEntries.ANGLE in EstimatedEntries(newest.estimated)
    assert EstimatedEntries.KXX not in EstimatedEntries(newest.estimated)
    assert EstimateFlags.DRIVING in EstimateFlags(newest.flags)
    host.set("ESTIMATE_EVERY", 0)  # live
    host.endpoint.send(DriveBoard(1))
    host.endpoint.send(Safe(SafeReason.HOST_REQUEST))
    assert not [message for message in until(host, Status) if isinstance(message, Estimate)]


# --------------------------------------------------------------------------------------------------------------- CAN


class _Drive(ctypes.Structure):
    _fields_ = [("ux", ctypes.c_int32), ("uy", ctypes.c_int32)]


_START = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_READ = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)


def test_over_can_it_comes_in_parts_and_whole(library: ctypes.CDLL) -> None:
    """Without a kernel's CAN: the library's frames, joined by this side's format."""
    kind: Any = struct_of(SPEC.messages["ESTIMATE"])
    told = {name: 0.5 * k - 3.0 for k, name in enumerate(Estimate._fields[3:])}

    def read(_: int, place: int) -> None:
        out = kind.from_address(place)
        out.estimated, out.flags = 0x3FFF, int(EstimateFlags.VALID)
        for name, value in told.items():
            setattr(out, name, value)

    board = CBoard(library, "can", estimator=read)
    assert board.works
    said, heard = Transmitter(CanFormat(0, HOST)), Receiver(CanFormat(0, HOST))

    def ask(message: Message) -> list[Message]:
        return [item.message for item in heard.feed(board.exchange(said.encode(message, 0)))]

    ask(Hello(SPEC.protocol, SPEC.hash))
    for name, value in {"CLOCK_MODE": 0, "LOOP_MODE": LoopMode.BOARD, "BLOCK": 4, "ESTIMATE_EVERY": 2}.items():
        ask(write(name, value))
    estimates = [message for message in ask(Arm()) if isinstance(message, Estimate)]
    estimates += [message for message in ask(DriveBoard(1)) if isinstance(message, Estimate)]
    assert [one.tick for one in estimates] == [3, 7]  # the link is asked once a block here: the newest is sent
    assert estimates[0]._asdict() == told | {"tick": 3, "estimated": 0x3FFF, "flags": 1}
    assert estimates[1].flags == EstimateFlags.VALID | EstimateFlags.DRIVING
    assert (heard.lost, heard.bad) == (0, 0)
