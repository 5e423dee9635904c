"""Force mode, sample by sample: timing of the answers, gaps, a board that trips, falls silent or forgets."""

import math
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from device_emulator.board import Board
from estimator.observer import Observer
from hil.records.capture import RowFlag
from hil.records.runfolder import RunFolder
from hil.records.summary import summarise
from hil.running.loop.skeleton import Loop
from hil.wire.errors import ProtocolError
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode, DriveForce
from hil.wire.stream import Receiver
from tests.running import closed, gyro
from tests.running.closed import HandPaced, amiss, angle_errors, answers_of, board, close_loop, waiting
from tests.wire.board import SmallBoard

WATCHDOG_TICKS = 80  # of S-slow's bench: 0.02 s
SETTLED_S = 0.5
ANGLE_RAD = 5e-3  # of error after that, with or without gaps


def innovation_ratio(run: RunFolder) -> float:
    """Innovation over what the observer predicts of it, after settling."""
    innovation = run.innovation
    assert innovation is not None
    scored = innovation.t_s >= SETTLED_S
    return float(np.sqrt(np.mean(innovation.nu_V[scored] ** 2) / np.mean(innovation.sd_V[scored] ** 2)))


class Overheard(InprocLink):
    """Notes every drive the host sends: (ux, uy, effective tick)."""

    def __init__(self, board: Board) -> None:
        super().__init__(board)
        self.drives: list[tuple[int, int, int]] = []
        self._rx = Receiver()

    def send(self, data: bytes) -> None:
        heard = (item.message for item in self._rx.feed(data))
        self.drives += [tuple(message) for message in heard if isinstance(message, DriveForce)]
        super().send(data)


@pytest.mark.moderate
@pytest.mark.parametrize("latency", [0, 1, 3])
def test_a_drive_acts_latency_ticks_after_its_sample(tmp_path: Path, latency: int) -> None:
    """And the loop holds the pattern at each latency, because the observer counts with it."""
    truth = tmp_path / "truth.arrow"
    scenario = gyro.scenario(tmp_path / "board.toml", drive={"latency_samples": latency})
    link = Overheard(board(scenario, truth=truth))
    run, counters = close_loop(link, gyro.bench(1.0), tmp_path / "run")
    capture = run.capture
    assert capture is not None
    assert (counters.samples, counters.lost, counters.held) == (4000, 0, 0)
    answers = answers_of(run, counters)
    assert (answers.ticks, answers.in_time, answers.slow) == (4000, 4000, 0)
    echoed = {
        int(tick): (int(ux), int(uy))
        for tick, ux, uy in zip(capture.tick, capture.columns["ux_code"], capture.columns["uy_code"], strict=True)
    }
    commanded = [(ux, uy, tick) for ux, uy, tick in link.drives if tick + 1 in echoed]
    assert len(commanded) == 4000 - 1 - latency
    assert all(echoed[tick + 1] == (ux, uy) for ux, uy, tick in commanded)
    assert sum(ux != 0 for ux, _, _ in commanded) > 3000
    assert capture.latency_ticks == latency
    assert np.abs(angle_errors(run, truth, SETTLED_S)).max() < ANGLE_RAD
    assert innovation_ratio(run) == pytest.approx(1.0, abs=0.1)


def paced(
    tmp_path: Path,
    *,
    lost: Container[int] = (),
    unheard: Container[int] = (),
    stops: Mapping[int, int] | None = None,
    chunk: int = 4096,
    watchdog_s: float = 0.02,
    rearm: int = 3,
    link: type[HandPaced] = HandPaced,
) -> tuple[RunFolder, dict[str, Any], dict[str, int]]:
    """A second of S-slow against a board that does not wait: the run, the host's counters, the board's.

    Whatever happened on the way, the angle is right afterwards and the observer knows how well it does.
    """
    truth = tmp_path / "truth.arrow"
    line = link(
        board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED, truth),
        lost=lost,
        unheard=unheard,
        stops=stops,
        chunk=chunk,
    )
    link_section = {"watchdog_s": watchdog_s, "timeout_s": 0.5}
    declared = gyro.bench(1.0, "paced", link=link_section, limits={"rearm": rearm})
    run, counters = close_loop(line, declared, tmp_path / "run")
    assert np.abs(angle_errors(run, truth, SETTLED_S)).max() < ANGLE_RAD
    assert innovation_ratio(run) < 1.2
    seen = vars(counters) | {"amiss": amiss(answers_of(run, counters))}
    return run, seen, seen.pop("board")


def gaps(run: RunFolder) -> list[tuple[int, int]]:
    """(first tick missing, how many) of each gap in the record, all of them flagged."""
    capture = run.capture
    assert capture is not None
    after = np.flatnonzero(np.diff(capture.tick) != 1) + 1
    assert np.array_equal(np.flatnonzero(capture.flags & RowFlag.GAP_BEFORE), after)
    first = capture.tick[after - 1] + 1
    return list(zip(first.tolist(), (capture.tick[after] - first).tolist(), strict=True))


def innovation_after(run: RunFolder, gap: int) -> float:
    """Innovation over its deviation at the first sample after a gap, the worse of both axes."""
    innovation = run.innovation
    assert innovation is not None
    row = np.searchsorted(innovation.tick, gap)
    return float(np.abs(innovation.nu_V[row] / innovation.sd_V[row]).max())


@pytest.mark.moderate
def test_lost_samples_are_bridged_and_counted(tmp_path: Path) -> None:
    lost = range(100, 3900, 17)  # from before the loop is closed, too
    run, host, device = paced(tmp_path, lost=lost)
    assert gaps(run) == [(tick, 1) for tick in lost]
    assert (host["lost"], host["samples"]) == (len(lost), 4000 - len(lost))
    assert device["held"] == host["held"] == len(lost)  # a sample not seen is an answer not given
    assert host["rearmed"] == 0
    assert host["amiss"] == {"lost_to_host": len(lost)}  # no answer was late: there was none to give


@pytest.mark.moderate
def test_a_burst_of_lost_samples_is_bridged(tmp_path: Path) -> None:
    run, host, device = paced(tmp_path, lost=range(1000, 1050))
    assert gaps(run) == [(1000, 50)]
    assert (host["lost"], host["rearmed"], device["held"]) == (50, 0, 50)
    assert innovation_after(run, 1000) < 4.0  # the drive that the board held all the while was taken into account


@pytest.mark.moderate
def test_after_a_long_silence_the_motion_is_found_anew(tmp_path: Path) -> None:
    run, host, _ = paced(tmp_path, lost=range(1000, 1700), watchdog_s=0.5)
    assert gaps(run) == [(1000, 700)]
    assert (host["lost"], host["rearmed"]) == (700, 0)


@pytest.mark.moderate
def test_lost_answers_are_counted_by_the_board(tmp_path: Path) -> None:
    unheard = range(500, 3900, 17)
    run, host, device = paced(tmp_path, unheard=unheard)
    capture = run.capture
    assert capture is not None
    held = capture.tick[(capture.flags & RowFlag.LATE_ANSWER_HELD) != 0]
    # the answer to row m would have acted from m + 1, which row m + 2 tells of
    assert held.tolist() == [tick + 2 for tick in unheard]
    assert device["held"] == device["lost_seq"] == host["held"] == len(unheard)
    assert host["amiss"] == {"lost_to_board": len(unheard)}
    assert amiss(summarise(run).answers) == {"late": len(unheard)}  # without what the board has counted nobody can tell


@pytest.mark.moderate
def test_the_longest_run_of_rows_without_a_drive_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By which a watchdog is accounted for: rows that do not follow each other are no run."""
    loops, make = list[Loop](), closed.make_loop
    monkeypatch.setattr(closed, "make_loop", lambda *given: loops.append(make(*given)) or loops[-1])
    paced(tmp_path, unheard=[*range(500, 530), *range(1000, 1200, 2), 2000])
    assert loops[0].board.account.held == (30, 1, 2003)


@pytest.mark.moderate
def test_a_host_stopped_for_less_than_the_watchdog_goes_on(tmp_path: Path) -> None:
    run, host, device = paced(tmp_path, stops={1500: 60})
    assert gaps(run) == []
    assert host["held"] == device["held"] == 59
    assert (host["rearmed"], device["watchdog_trips"]) == (0, 0)
    timing, capture = run.timing, run.capture
    assert timing is not None
    assert capture is not None
    unanswered = np.setdiff1d(capture.tick, timing.tick)  # seen too late to be answered
    assert unanswered.tolist() == list(range(1500, 1559))
    assert timing.turnaround_us.min() > 0.0
    assert host["amiss"] == {"unanswered": 59}  # of 60 samples that it sees at once the newest is answered


@pytest.mark.moderate
def test_a_host_stopped_for_longer_arms_the_board_again(tmp_path: Path) -> None:
    run, host, device = paced(tmp_path, stops={1500: 300})
    ((first, missing),) = gaps(run)
    assert first + missing == 1500 + 300  # no tick passes before the host arms it again
    assert (host["rearmed"], host["lost"]) == (1, missing)
    assert device["watchdog_trips"] == 1
    capture = run.capture
    assert capture is not None
    driven = capture.tick[(capture.tick < first) & capture.drive.any(axis=1)]
    # row 1499 was the last to be answered: the drive is held for as long as the watchdog allows, no longer
    assert driven[-1] == 1499 + WATCHDOG_TICKS
    assert first > driven[-1]
    assert capture.drive[capture.tick > 2000].any()
    # The watchdog's 80 ticks; the row that says SAFE is the newest, and is answered. What is missing then was not lost.
    assert host["amiss"] == {"unanswered": 80, "stopped": 300 - 81}
    assert amiss(summarise(run).answers)["lost_to_host"] == 300 - 81  # the record does not say who caused a gap


class Slow(HandPaced):
    """In SAFE its board counts no ticks until it has been armed: those that have passed come behind its answer."""

    _owed = 0

    def _tick(self) -> None:
        if self.board.streaming:
            super()._tick()
        else:
            self._owed += 1

    def send(self, data: bytes) -> None:
        super().send(data)
        if self.board.streaming and self._owed:
            self.board.coast(self._owed)
            self._owed = 0


@pytest.mark.long
def test_a_host_that_stood_still_for_long_accuses_nobody(tmp_path: Path) -> None:
    """Of 12 s the board was SAFE for all but the watchdog: its ticks went on, as they must."""
    device = board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED)
    declared = gyro.bench(12.5, "paced", link={"watchdog_s": 0.02, "timeout_s": 0.5})
    _, counters = close_loop(HandPaced(device, stops={1000: 48_000}), declared, tmp_path / "run")
    assert (counters.rearmed, counters.skipped, counters.board["watchdog_trips"]) == (1, 0, 1)


@pytest.mark.moderate
@pytest.mark.parametrize("ticks", [100, 150, 300, 600])
def test_whatever_tick_it_was_armed_at_the_stop_is_no_gap_in_a_driven_run(tmp_path: Path, ticks: int) -> None:
    """A board that says ARMED of the tick at which it stopped: the rows that are missing then had no drive."""
    run, host, _ = paced(tmp_path, stops={1500: ticks}, link=Slow)
    ((_, missing),) = gaps(run)
    assert host["rearmed"] == 1
    assert missing >= ticks - WATCHDOG_TICKS - 1


@pytest.mark.moderate
@pytest.mark.parametrize("lost", [range(1450, 1460), range(1440, 1500)])
def test_a_gap_over_which_the_board_held_another_drive_than_it_was_sent(tmp_path: Path, lost: range) -> None:
    """The answers to the last rows before it were lost as well."""
    _, host, device = paced(tmp_path, lost=lost, unheard=range(lost.start - 6, lost.start))
    assert host["lost"] == len(lost)
    assert device["lost_seq"] == 6


@pytest.mark.moderate
def test_it_is_armed_again_when_the_news_was_lost_as_well(tmp_path: Path) -> None:
    """The line loses what the board says as it trips; then its refusal of the next drive tells."""
    run, host, device = paced(tmp_path, stops={1500: 300}, lost=range(1550, 1600))
    assert (host["rearmed"], device["watchdog_trips"]) == (1, 1)
    assert [first for first, _ in gaps(run)] == [1550]


@pytest.mark.slow
def test_late_refusals_do_not_arm_it_twice(tmp_path: Path) -> None:
    """A line that gives less than a sample at a time: each is answered, and refused, before the host knows why."""
    _, host, device = paced(tmp_path, stops={1500: 300}, chunk=20)
    assert (host["rearmed"], device["watchdog_trips"]) == (1, 1)


@pytest.mark.slow
def test_stopped_again_and_again(tmp_path: Path) -> None:
    run, host, device = paced(tmp_path, stops=dict.fromkeys(range(1000, 2600, 400), 200), rearm=4)
    assert host["rearmed"] == device["watchdog_trips"] == 4
    assert len(gaps(run)) == 4


@pytest.mark.moderate
def test_a_wild_record_stops_the_run(tmp_path: Path) -> None:
    """One axis declared with the wrong sign: closing the loop drives it apart, and soon it is opened again."""
    declared = gyro.bench(2.0, device={"sense": {"gain_V_per_m": (885.42, -885.42)}})
    link = waiting(gyro.scenario(tmp_path / "board.toml"))
    _, counters = close_loop(link, declared, tmp_path / "run")
    assert counters.residual_safe == 1
    assert counters.samples < 2000


@pytest.mark.moderate
def test_not_a_number_stops_the_run(tmp_path: Path) -> None:
    def spoil(observer: Observer) -> None:
        observer.x[:] = math.nan

    link = waiting(gyro.scenario(tmp_path / "board.toml"))
    run, counters = close_loop(link, gyro.bench(1.0), tmp_path / "run", spoil)
    assert counters.residual_safe == 1
    assert counters.samples < 1000
    assert run.capture is not None
    assert not run.capture.drive.any()


class Mute(SmallBoard):
    """Has nothing more to say after 50 samples."""

    def exchange(self, data: bytes) -> bytes:
        return super().exchange(data) if self.tick < 50 else b""


class Forgetful(SmallBoard):
    """Starts to count anew after 50 samples."""

    def exchange(self, data: bytes) -> bytes:
        self.tick = self.tick % 50
        return super().exchange(data)


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("board", "message"),
    [
        (Mute(), "inproc: the board fell silent for 0.05 s; check the board's supply and the cable"),
        (Forgetful(), "inproc: the board's tick went back from 49 to 0; did it restart?"),
    ],
)
def test_a_board_that_is_not_itself_ends_the_run(tmp_path: Path, board: SmallBoard, message: str) -> None:
    declared = gyro.bench(link={"timeout_s": 0.05})
    with pytest.raises(ProtocolError) as caught:
        close_loop(InprocLink(board), declared, tmp_path / "run")
    assert str(caught.value) == message
    run = RunFolder(tmp_path / "run")
    assert run.capture is not None
    assert (len(run.capture), run.capture.complete) == (50, False)
