"""Gain mode, block by block: a matrix from estimates, its tick, gaps that are bridged, a board that trips or drops."""

import math
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from device_emulator.board import Board
from estimator.observer import Observer
from hil.bench import Bench
from hil.errors import InputError
from hil.records.capture import RowFlag
from hil.records.runfolder import RunFolder
from hil.running import run as whole
from hil.running.loop.gain import BlockLoop
from hil.running.loop.skeleton import BeyondLimits
from hil.running.request import RunRequest
from hil.running.safety.preflight import require_suitable
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.inproc import InprocLink
from hil.wire.messages import Capabilities, ClockMode, DriveGains
from hil.wire.stream import Receiver
from tests.running import gyro
from tests.running.closed import HandPaced, amiss, angle_errors, answers_of, board, close_loop, waiting
from tests.running.test_force_loop import innovation_ratio
from tests.wire.board import SmallBoard

BLOCK = 20
WATCHDOG_TICKS = 80
ANGLE_RAD = 5e-3


def bench(duration_s: float = 1.0, clock: str = "lockstep", **changes: dict[str, Any]) -> Bench:
    loop = {"mode": "gain", "block": BLOCK, "estimate_every": BLOCK} | changes.pop("loop", {})
    return gyro.bench(duration_s, clock, loop=loop, **changes)


class Overheard(InprocLink):
    """Notes every matrix the host sends."""

    def __init__(self, what: Board) -> None:
        super().__init__(what)
        self.gains: list[DriveGains] = []
        self._rx = Receiver()

    def send(self, data: bytes) -> None:
        self.gains += [r.message for r in self._rx.feed(data) if isinstance(r.message, DriveGains)]
        super().send(data)


@pytest.mark.moderate
@pytest.mark.parametrize("latency", [0, 1, 2])
def test_the_pattern_is_held_and_the_angle_right(tmp_path: Path, latency: int) -> None:
    truth = tmp_path / "truth.arrow"
    scenario = gyro.scenario(tmp_path / "board.toml", drive={"latency_samples": latency})
    link = Overheard(board(scenario, truth=truth))
    run, counters = close_loop(link, bench(), tmp_path / "run")
    assert innovation_ratio(run) == pytest.approx(1.0, abs=0.05)
    assert np.abs(angle_errors(run, truth, 0.6)).max() < ANGLE_RAD
    estimates, capture, timing = run.estimates, run.capture, run.timing
    assert estimates is not None
    assert capture is not None
    assert timing is not None
    settled = estimates.t_s >= 0.6
    assert np.abs(estimates["energy_ratio"][settled] - 1.0).max() < 0.03
    assert np.abs(estimates["quadrature_ratio"][settled]).max() < 0.03
    assert (estimates.tick % BLOCK == BLOCK - 1).all()
    assert len(estimates.tick) == len(capture) / BLOCK == 200
    assert (counters.lost, counters.board["late"]) == (0, 0)
    answers = answers_of(run, counters)
    assert (answers.ticks, answers.in_time, answers.slow) == (4000, 4000, 0)
    # Every block is answered by a matrix for the very next tick, and that is when it is used.
    *answers, offered = link.gains
    assert [g.effective_tick for g in answers] == list(range(BLOCK, 4001, BLOCK))
    assert not any((*offered.gain, *offered.bias))  # after SAFE, for the board to refuse
    assert timing.columns["applied_tick"].tolist() == [*(timing.tick[:-1] + 1).tolist(), -1]  # the last is not seen
    assert timing.applied is not None
    assert timing.ledger_us(timing.applied) == {}  # in lockstep ticks follow no clock
    # 0.1 s of acquisition: no force before, and of dither neither, which the board adds itself.
    closed = next(k for k, g in enumerate(link.gains) if any(g.gain))
    assert closed == 400 // BLOCK
    driven = np.flatnonzero(capture.drive.any(axis=1))
    assert driven[0] == BLOCK + latency + 1
    dither = np.abs(capture.drive[BLOCK + latency + 1 : 400])
    np.testing.assert_allclose(dither, 0.3, atol=3e-4)


@pytest.mark.moderate
def test_estimates_are_so_many_samples_apart_however_blocks_are_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link may cut blocks into shorter ones, as CAN does, of which no multiple is where an estimate is due."""
    bind = BlockLoop._bind

    def cut(loop: BlockLoop) -> None:
        loop._blocks.every = 33
        bind(loop)

    monkeypatch.setattr(BlockLoop, "_bind", cut)
    run, _ = close_loop(waiting(gyro.scenario(tmp_path / "board.toml")), bench(0.5), tmp_path / "run")
    assert run.estimates is not None
    assert run.estimates.tick.tolist() == list(range(32, 2000, 33))


@pytest.mark.moderate
@pytest.mark.parametrize("kind", ["pair", "luenberger"])
def test_both_filters_do(tmp_path: Path, kind: str) -> None:
    truth = tmp_path / "truth.arrow"
    link = waiting(gyro.scenario(tmp_path / "board.toml"), truth)
    run, _ = close_loop(link, bench(loop={"filter": kind}), tmp_path / "run")
    assert np.abs(angle_errors(run, truth, 0.6)).max() < ANGLE_RAD


@pytest.mark.moderate
def test_a_virtual_rotation_that_is_reversed_stays_bounded(tmp_path: Path) -> None:
    """A matrix holds for a whole block: the reversal falls where a block begins, and the angle allows for it."""
    truth = tmp_path / "truth.arrow"
    declared = bench(1.5, controller={"virtual_reversal_s": 0.25})
    run, _ = close_loop(waiting(gyro.scenario(tmp_path / "board.toml"), truth), declared, tmp_path / "run")
    assert np.abs(angle_errors(run, truth, 0.6)).max() < ANGLE_RAD
    estimates = run.estimates
    assert estimates is not None
    forced = estimates["angle_forced_rad"][estimates.t_s >= 0.6]
    swing = declared.controller.virtual_rotation_rad_s * 0.25  # up and down again by as much
    assert 0.8 * swing < np.ptp(forced) < 1.2 * swing


@pytest.mark.moderate
def test_the_same_again_is_the_same_record(tmp_path: Path) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    first, again = (close_loop(waiting(scenario), bench(0.5), tmp_path / name)[0] for name in ("first", "again"))
    for path in (first.capture_path, first.estimates_path, first.innovation_path):
        assert path.read_bytes() == (again.path / path.name).read_bytes()


@pytest.mark.moderate
def test_estimates_less_often_than_blocks(tmp_path: Path) -> None:
    declared = bench(0.5, loop={"estimate_every": 5 * BLOCK})
    run, _ = close_loop(waiting(gyro.scenario(tmp_path / "board.toml")), declared, tmp_path / "run")
    assert run.estimates is not None
    assert run.estimates.tick.tolist() == list(range(99, 2000, 100))


@pytest.mark.moderate
def test_open_loop_sends_nothing_but_zeros(tmp_path: Path) -> None:
    link = Overheard(board(gyro.scenario(tmp_path / "board.toml")))
    run, _ = close_loop(link, bench(0.5, controller={"enabled": False}), tmp_path / "run")
    assert run.capture is not None
    assert not run.capture.drive.any()
    assert not any(any(g.gain) or any(g.bias) for g in link.gains)


# -------------------------------------------------------------------------------- a board that does not wait


def paced(tmp_path: Path, *, watchdog_s: float = 0.02, **meddling: Any) -> tuple[RunFolder, dict[str, Any], Path]:
    """A run of 0.9 s with a board on wall time whose blocks or answers get lost."""
    truth = tmp_path / "truth.arrow"
    device = board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED, truth)
    declared = bench(0.9, "paced", link={"watchdog_s": watchdog_s})
    run, counters = close_loop(HandPaced(device, **meddling), declared, tmp_path / "run")
    return run, vars(counters) | {"amiss": amiss(answers_of(run, counters))}, truth


def gaps(run: RunFolder) -> list[tuple[int, int]]:
    """(first missing tick, how many) of each gap; each is marked in the record."""
    assert run.capture is not None
    tick = run.capture.tick
    jumps = np.flatnonzero(np.diff(tick) != 1)
    np.testing.assert_array_equal(np.flatnonzero(run.capture.flags & RowFlag.GAP_BEFORE), jumps + 1)
    return [(int(tick[k]) + 1, int(tick[k + 1] - tick[k]) - 1) for k in jumps]


def innovation_after(run: RunFolder, gap: tuple[int, int], within: int = 40) -> float:
    """Largest innovation after a gap, in units of the noise (89 µV)."""
    assert run.innovation is not None
    first = gap[0] + gap[1]
    rows = (run.innovation.tick >= first) & (run.innovation.tick < first + within)
    return float(np.abs(run.innovation.nu_V[rows]).max() / 8.9e-5)


@pytest.mark.moderate
def test_nothing_is_lost_on_a_quiet_line(tmp_path: Path) -> None:
    run, counters, truth = paced(tmp_path)
    assert gaps(run) == []
    assert (counters["lost"], counters["board"]["late"], counters["board"]["watchdog_trips"]) == (0, 0, 0)
    assert counters["amiss"] == {}
    timing = run.timing
    assert timing is not None
    # Meant for the block after the next, and used from its first tick on.
    assert timing.applied is not None
    assert timing.applied.tolist() == [*(timing.tick[:-1] + BLOCK).tolist(), -1]  # the last is not seen
    assert set(timing.ledger_us(timing.applied)) == {"wire", "estimate", "send", "apply", "total"}
    assert np.abs(angle_errors(run, truth, 0.6)).max() < ANGLE_RAD


@pytest.mark.moderate
def test_lost_blocks_are_counted_marked_and_bridged(tmp_path: Path) -> None:
    """Without knowing what the board drove meanwhile, dither and all, the prediction would be off by far more."""
    run, counters, truth = paced(tmp_path, lost={2000, 2020, 2600, 3000})
    assert gaps(run) == [(2000, 40), (2600, 20), (3000, 20)]
    assert counters["lost"] == 80
    assert counters["amiss"] == {"lost_to_host": 80}
    assert counters["rearmed"] == 0
    assert all(innovation_after(run, gap) < 4.5 for gap in gaps(run))
    assert np.abs(angle_errors(run, truth, 0.45)).max() < ANGLE_RAD


@pytest.mark.moderate
def test_after_a_long_silence_the_motion_is_found_anew(tmp_path: Path) -> None:
    run, counters, _ = paced(tmp_path, lost=range(2000, 2400), watchdog_s=0.5)
    assert gaps(run) == [(2000, 400)]
    assert (counters["lost"], counters["rearmed"]) == (400, 0)
    assert run.innovation is not None
    assert np.abs(run.innovation.nu_V[-200:]).max() < 6 * 8.9e-5


@pytest.mark.moderate
def test_blocks_that_piled_up_are_all_observed_and_the_newest_is_answered(tmp_path: Path) -> None:
    run, counters, truth = paced(tmp_path, stops={2000: 3}, watchdog_s=0.05)
    assert gaps(run) == []
    assert counters["lost"] == 0
    assert counters["amiss"] == {"unanswered": 2 * BLOCK}
    timing, capture = run.timing, run.capture
    assert timing is not None
    assert capture is not None
    ends = np.arange(BLOCK - 1, len(capture), BLOCK)
    assert np.setdiff1d(ends[:-2], timing.tick).tolist() == [2019, 2039]
    assert np.abs(angle_errors(run, truth, 0.6)).max() < ANGLE_RAD


@pytest.mark.moderate
def test_a_lost_matrix_leaves_the_one_before_in_force(tmp_path: Path) -> None:
    unheard = set(range(1000, 3500, 60))
    ends = {tick + BLOCK - 1 for tick in unheard}
    run, counters, truth = paced(tmp_path, unheard=ends)
    assert counters["board"]["lost_seq"] == len(ends)
    assert counters["amiss"] == {"lost_to_board": len(ends) * BLOCK}
    timing = run.timing
    assert timing is not None
    assert ends.isdisjoint(timing.tick[timing.columns["applied_tick"] >= 0].tolist())
    assert np.abs(angle_errors(run, truth, 0.6)).max() < ANGLE_RAD


class Slow(HandPaced):
    """What the host says takes 20 blocks, 0.1 s, to arrive, once the board streams."""

    def __init__(self, device: Board) -> None:
        super().__init__(device)
        self._travelling: deque[tuple[int, bytes]] = deque()

    def send(self, data: bytes) -> None:
        if self.board.streaming:
            self._travelling.append((self.board.rows + 20 * BLOCK, data))
        else:
            super().send(data)

    def receive(self, timeout_s: float | None) -> bytes:
        while self._travelling and self._travelling[0][0] <= self.board.rows:
            super().send(self._travelling.popleft()[1])
        return super().receive(timeout_s)


class Backlog(HandPaced):
    """What the board says waits behind 150 blocks that the host has not read: it lags by that, and goes on to."""

    def __init__(self, device: Board) -> None:
        super().__init__(device)
        self._unread: deque[bytes] = deque()

    def receive(self, timeout_s: float | None) -> bytes:
        while self.board.streaming and len(self._unread) < 150:
            self._unread.append(super().receive(timeout_s))
        return self._unread.popleft() if self._unread else super().receive(timeout_s)


@pytest.mark.moderate
def test_a_host_that_lags_holds_nothing_against_the_board(tmp_path: Path) -> None:
    device = board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED)
    declared = bench(2.0, "paced", link={"watchdog_s": 1.0, "timeout_s": 5.0}, limits={"residual_safe": 1e9})
    run, counters = close_loop(Backlog(device), declared, tmp_path / "run")
    assert (counters.lost, counters.rearmed) == (0, 0)
    assert counters.board["late"] > 350
    assert run.capture is not None
    assert len(run.capture) == 8000


@pytest.mark.moderate
def test_the_holds_are_as_slow_as_the_line(tmp_path: Path) -> None:
    """Holds that act on what was a tenth of a second ago as if it were a hundredth would swing up."""
    device = board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED)
    declared = bench(2.0, "paced", link={"watchdog_s": 0.5, "timeout_s": 5.0})
    run, counters = close_loop(Slow(device), declared, tmp_path / "run")
    assert counters.board["late"] > 350
    estimates = run.estimates
    assert estimates is not None
    assert np.abs(estimates["energy_ratio"][estimates.t_s > 1.5] - 1.0).max() < 0.1


@pytest.mark.moderate
def test_a_host_stopped_for_longer_than_the_watchdog_arms_the_board_again(tmp_path: Path) -> None:
    run, counters, _ = paced(tmp_path, stops={2000: 15})
    assert (counters["rearmed"], counters["board"]["watchdog_trips"]) == (1, 1)
    ((first, missing),) = gaps(run)
    assert counters["lost"] == missing == counters["amiss"]["stopped"]
    # The newest of what had come was answered to a board that was SAFE by then.
    assert (counters["amiss"].get("lost_to_host"), counters["amiss"]["lost_to_board"]) == (None, BLOCK)
    capture = run.capture
    assert capture is not None
    before = capture.tick[(capture.tick < first) & capture.drive.any(axis=1)]
    # Row 1999 was the last the host answered: driven for as long as the watchdog allows, and not a tick longer.
    assert before[-1] == 1999 + WATCHDOG_TICKS
    assert capture.drive[capture.tick > 2600].any()
    assert run.innovation is not None
    assert np.abs(run.innovation.nu_V[-200:]).max() < 6 * 8.9e-5


# -------------------------------------------------------------------------------- what cannot be


def test_a_board_without_gain_mode_is_refused() -> None:
    endpoint = Endpoint(InprocLink(SmallBoard()))
    identity = client.connect(endpoint)._replace(capabilities=Capabilities.FORCE_MODE | Capabilities.LOCKSTEP)
    with pytest.raises(InputError, match=r'cannot close the loop itself; use \[loop\] mode = "force"'):
        require_suitable(bench(), identity, "inproc")


@pytest.mark.moderate
def test_the_residual_is_judged_before_the_answer_leaves(tmp_path: Path) -> None:
    """Each sample of a block is: the block with the one that stops the run is recorded, and not answered."""
    declared = bench(2.0, device={"sense": {"gain_V_per_m": (885.42, -885.42)}})
    link = Overheard(board(gyro.scenario(tmp_path / "board.toml")))
    run, counters = close_loop(link, declared, tmp_path / "run")
    assert run.capture is not None
    assert counters.residual_safe == 1
    assert counters.samples == len(run.capture) < 3000
    *answers, offered = link.gains
    assert not any((*offered.gain, *offered.bias))  # after SAFE, for the board to refuse
    assert [g.effective_tick for g in answers] == list(range(BLOCK, len(run.capture), BLOCK))


@pytest.mark.parametrize("number", [math.nan, math.inf, 2e18])
def test_a_matrix_that_no_board_takes_is_not_sent(tmp_path: Path, number: float) -> None:
    """Whatever gives the matrix is not trusted."""

    link = Overheard(board(gyro.scenario(tmp_path / "board.toml")))

    def spoil(observer: Observer) -> None:
        observer.arrays.settings["quantum"] = {math.nan: math.nan, math.inf: 0.0}.get(number, 1e-30)

    with pytest.raises(BeyondLimits, match=r"a matrix with .* in it, which no board takes: nothing was sent"):
        close_loop(link, bench(0.5), tmp_path / "run", spoil)
    assert not any(any((*g.gain, *g.bias)) for g in link.gains)


@pytest.mark.long
def test_one_seed_is_one_record_on_any_link(tmp_path: Path, no_report: None) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    first, far = (
        RunFolder(
            whole.run(RunRequest(bench(1.0), f"{kind}:{scenario}"), tmp_path / kind, progress=lambda _: None).folder
            or tmp_path
        )
        for kind in ("inproc", "pty")
    )
    for path in (first.capture_path, first.estimates_path, first.innovation_path):
        assert path.read_bytes() == (far.path / path.name).read_bytes()


@pytest.mark.long
@pytest.mark.realtime
def test_in_real_time_over_a_pty(tmp_path: Path) -> None:
    """Slow enough for any machine: nothing lost, every block in the ledger, the load told."""
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    truth = tmp_path / "truth.arrow"
    declared = gyro.unhurried_bench(4.0, loop={"mode": "gain", "block": BLOCK, "estimate_every": BLOCK})
    request = RunRequest(declared, f"pty:{scenario}", {"truth": truth})
    folder = whole.run(request, tmp_path, progress=lambda _: None).folder
    assert folder is not None
    result = RunFolder(folder).result
    assert result is not None
    assert (result.mode, result.samples, result.lost, result.counters["rearmed"]) == ("gain", 1600, 0, 0)
    assert result.ledger_us is not None
    assert 0.0 < result.ledger_us.estimate.p50 < result.ledger_us.total.p50
    assert result.ledger_us.total.p50 == pytest.approx(BLOCK / 400 * 1e6, rel=0.2)
    assert result.load is not None
    assert 0.0 < result.load.loop < 1.0
    assert np.abs(angle_errors(RunFolder(folder), truth, 3.0)).max() < 0.02
    assert "A block of samples" in RunFolder(folder).report_path.read_text()
