"""The board is asked for its time before, during and after a run, and the answers give its clock."""

import math
from collections.abc import Callable, Iterable
from html import escape
from pathlib import Path
from typing import Any

import pytest

from hil.records.capture import TIME_LOCKSTEP, TIME_RUNNING
from hil.records.result import BoardClock, ClockRelation, Result
from hil.records.runfolder import RunFolder
from hil.running.process.clock import ClockExchanges
from hil.running.request import RunRequest
from hil.running.run import run
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode, TimeSync
from tests.running import gyro
from tests.running.closed import HandPaced, board, close_loop
from tests.wire.board import SmallBoard


class Kept:
    """A track that keeps its rows."""

    dropped = 0

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []

    def put(self, *values: float) -> bool:
        self.rows.append(values)
        return True

    def push(self, rows: Any) -> int:
        raise AssertionError("rows come one by one")


class TellsTime(SmallBoard):
    """Answers each question for the time with what `answers` makes of it, and nothing else."""

    def __init__(self, answers: Callable[[TimeSync], Iterable[TimeSync]]) -> None:
        super().__init__()
        self.answers = answers
        self.asked = 0

    def exchange(self, data: bytes) -> bytes:
        said = b""
        for item in self.rx.feed(data):
            assert isinstance(item.message, TimeSync)
            self.asked += 1
            said += b"".join(self.tx.encode(answer, self.tick) for answer in self.answers(item.message))
        return said


def connected(scenario: Path) -> Endpoint:
    endpoint = Endpoint(InprocLink(board(scenario, ClockMode.PACED)))
    client.connect(endpoint)
    return endpoint


def test_a_burst_is_recorded_in_order(tmp_path: Path) -> None:
    kept = Kept()
    ClockExchanges(connected(gyro.scenario(tmp_path / "board.toml")), kept).burst()
    assert 8 <= len(kept.rows) <= 32
    times = [time for _, *exchange in kept.rows for time in exchange]  # sent, board, received, sent, …
    assert times == sorted(times)  # the board shares our clock here


@pytest.mark.moderate
def test_a_board_that_never_answers_is_not_asked_while_it_runs() -> None:
    silent = TellsTime(lambda _: ())
    exchanges = ClockExchanges(Endpoint(InprocLink(silent)), kept := Kept(), per_s=math.inf)
    exchanges.burst()
    asked = silent.asked
    exchanges.ask()
    assert 1 <= asked == silent.asked
    assert kept.rows == []


@pytest.mark.parametrize(
    "wrong",
    [
        lambda question: question._replace(host_ns=5, board_ns=6),  # nobody asked at 5
        lambda question: question._replace(board_ns=1 << 63),  # no time, and more than the record holds
    ],
)
def test_answers_that_are_none_are_left_out(wrong: Callable[[TimeSync], TimeSync]) -> None:
    board = TellsTime(lambda question: (wrong(question), question._replace(board_ns=77)))
    ClockExchanges(Endpoint(InprocLink(board)), kept := Kept()).burst()
    assert len(kept.rows) == board.asked > 0
    assert {row[2] for row in kept.rows} == {77}


def test_a_second_answer_to_one_question_is_left_out() -> None:
    board = TellsTime(lambda question: (question._replace(board_ns=77), question._replace(board_ns=78)))
    ClockExchanges(Endpoint(InprocLink(board)), kept := Kept()).burst()
    assert {row[2] for row in kept.rows} == {77}


def test_an_answer_that_comes_by_itself_is_followed_by_one_more_question() -> None:
    board = TellsTime(lambda question: (question._replace(board_ns=77),))
    endpoint = Endpoint(InprocLink(board))
    exchanges = ClockExchanges(endpoint, kept := Kept(), per_s=math.inf)
    exchanges.burst()
    before = board.asked
    exchanges.follow()  # nothing has come
    assert board.asked == before
    exchanges.ask()
    exchanges.follow()  # not yet
    assert board.asked == before + 1
    for _ in range(3):
        endpoint.receive_rows(0.0)
        exchanges.follow()
    assert board.asked == before + 2
    exchanges.keep()
    assert len(kept.rows) == board.asked


def test_questions_are_rationed(tmp_path: Path) -> None:
    endpoint = connected(gyro.scenario(tmp_path / "board.toml"))
    exchanges = ClockExchanges(endpoint, kept := Kept(), per_s=1e-3)
    exchanges.burst()
    before = len(kept.rows)
    for _ in range(10):
        exchanges.ask()
        endpoint.poll(0.0)
    assert len(kept.rows) == before


@pytest.mark.moderate
@pytest.mark.parametrize("mode", ["force", "gain"])
def test_asking_changes_nothing_in_the_record(tmp_path: Path, mode: str) -> None:
    """With and without a question every forty samples: the same bytes."""
    loop = {"mode": mode, "estimate_every": 20} | ({"block": 20} if mode == "gain" else {})
    runs = []
    for ask_every in (0, 40):
        link = HandPaced(board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED))
        declared = gyro.bench(0.5, "paced", loop=loop)
        folder, counters = close_loop(link, declared, tmp_path / f"{mode}-{ask_every}", ask_every=ask_every)
        assert (counters.samples, counters.lost, counters.rearmed) == (2000, 0, 0)
        runs.append(folder)
    silent, asked = runs
    for path in (silent.capture_path, silent.estimates_path, silent.innovation_path):
        assert path.read_bytes() == (asked.path / path.name).read_bytes(), path.name
    assert silent.clock is not None
    assert asked.clock is not None
    assert len(silent.clock.tick) == 0
    assert len(asked.clock.tick) > 40
    assert asked.clock.tick.max() > 1900


def recorded(bench: Any, link: str, out: Path) -> tuple[RunFolder, Result]:
    folder = run(RunRequest(bench, link), out, progress=lambda _: None).folder
    assert folder is not None
    done = RunFolder(folder)
    assert done.result is not None
    assert done.capture is not None
    return done, done.result


def test_a_relation_is_written_with_a_minus_that_is_one() -> None:
    relation = ClockRelation(
        at_host_ns=0, offset_ns=-1_500_000, offset_uncertainty_ns=2000, skew_ppm=-0.13, skew_uncertainty_ppm=0.02,
        skew_bound_ppm=0.1, round_trip_us=12.0, exchanges=50, used=10,
    )  # fmt: skip
    line = BoardClock(time_base=TIME_RUNNING, relation=relation).line
    assert line.startswith("−0.13 ± 0.02 ppm relative to the host's, offset −0.001500 s")


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_in_lockstep_bench_time_is_the_boards(tmp_path: Path) -> None:
    """No second clock: said so, and nobody is asked."""
    scenario = gyro.scenario(tmp_path / "board.toml")
    folder, result = recorded(gyro.bench(0.1), f"inproc:{scenario}", tmp_path)
    assert not folder.clock_path.exists()
    assert result.board_clock is not None
    assert (result.board_clock.time_base, result.board_clock.relation) == (TIME_LOCKSTEP, None)
    assert (
        result.board_clock.line
        == "not compared with the host's; in lockstep the board's time stops until the host answers"
    )
    assert folder.capture is not None
    assert folder.capture.header["time"] == TIME_LOCKSTEP
    assert folder.capture.header["columns"]["tick"]["clock"] == "bench"


@pytest.mark.slow
@pytest.mark.beyond(1)
@pytest.mark.realtime
@pytest.mark.parametrize("mode", ["force", "gain"])
def test_the_skew_of_a_board_is_found(tmp_path: Path, mode: str) -> None:
    """The emulated board's clock runs fast by what its scenario says; otherwise it is this machine's, so that the
    offset is known as well. What is stated of both holds, and the report tells it."""
    skew = 2e-3
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    scenario.write_text(scenario.read_text() + f"\n[faults]\nclock_skew = {skew}\n")
    loop = {"mode": mode, "estimate_every": 20} | ({"block": 20} if mode == "gain" else {})
    folder, result = recorded(gyro.unhurried_bench(3.0, loop=loop), f"pty:{scenario}", tmp_path)
    assert result.board_clock is not None
    assert result.board_clock.time_base == TIME_RUNNING
    found = result.board_clock.relation
    assert found is not None, result.board_clock.unknown
    assert found.exchanges > 40
    error_ppm = abs(found.skew_ppm - 1e6 * skew)
    assert error_ppm <= found.skew_bound_ppm < 0.1 * 1e6 * skew
    assert error_ppm <= 3.0 * found.skew_uncertainty_ppm  # the interval itself is missed once in twenty times
    # Board's time is (1 + skew) × the host's.
    assert abs(found.offset_ns - skew * found.at_host_ns) <= found.offset_uncertainty_ns
    assert found.offset_uncertainty_ns >= 500.0 * found.round_trip_us
    # The board samples on its own clock, by which it says another rate.
    rate = result.board_clock.sample_rate
    assert rate is not None
    assert abs(rate.off_ppm - 1e6 * skew) <= max(3.0 * rate.uncertainty_ppm, 0.1 * 1e6 * skew)
    assert result.parts["model"].outcome == "lacks"
    assert "IDENTITY says" in result.parts["model"].reason
    timing = folder.timing
    assert timing is not None
    tick, received = timing.tick[[0, -1]], timing.columns["t_receive_ns"][[0, -1]]
    assert 400.0 * (received[1] - received[0]) * 1e-9 / (tick[1] - tick[0]) == pytest.approx(1 / (1 + skew), abs=1e-3)
    assert result.ledger_us is not None
    assert result.ledger_us.wire.p50 < result.ledger_us.total.p50
    assert escape(result.board_clock.line) in folder.report_path.read_text(encoding="utf-8")
