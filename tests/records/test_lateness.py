"""How late answers were, from wall times whose lateness is known, and what follows for a board that waits longer.

The interval is held against SciPy's Student distribution and against series that were drawn.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from hil.records.lateness import BATCH_S, Lateness, lateness_of
from hil.records.result import Answers
from hil.records.summary import count_answers
from hil.records.timing import Timing
from hil.verdict import machine
from hil.wire.messages import ClockMode
from tests.running import gyro
from tests.running.closed import HandPaced, board, close_loop

RATE_HZ = 4000.0
TICK_S = 1.0 / RATE_HZ


def lateness(after_s: np.ndarray, *, counted: float = 0.0, lost: float = 0.0) -> Lateness:
    return Lateness(after_s, np.zeros(after_s.size), RATE_HZ, 1, TICK_S, counted, lost)


class Written:
    """A run folder of which only wall times are there."""

    def __init__(self, timing: Timing) -> None:
        self.timing, self.capture, self.clock = timing, object(), None


def timing(tick: np.ndarray, after_us: np.ndarray, *, block: int = 1, estimate_us: float = 50.0) -> Timing:
    sampled = (tick * 1e9 / RATE_HZ).astype(np.int64)
    sent = sampled + (1e3 * after_us).astype(np.int64)
    received = sampled + 1000  # the fastest of them is what the clock goes by
    columns = {"tick": tick, "t_receive_ns": received, "t_estimate_ns": received + round(1e3 * estimate_us)}
    columns["t_send_ns"] = sent
    header = {"tick_rate_Hz": RATE_HZ, "deadline_us": 1e6 * block / RATE_HZ}
    if block > 1:
        columns["applied_tick"] = tick + block + 1
        header["block"] = block
    return Timing(columns, header, True)


def all_answered(ticks: int, **parts: int) -> Answers:
    none = dict.fromkeys(("late", "unanswered", "lost_to_board", "lost_to_host", "stopped", "slow"), 0) | parts
    return Answers(ticks=ticks, in_time=ticks - sum(parts.values()), **none)


def test_of_each_sample_the_time_to_its_answer() -> None:
    tick = np.arange(1000)
    after_us = np.full(1000, 100.0)
    after_us[500:510] = 600.0
    found = lateness_of(Written(timing(tick, after_us)), all_answered(1000))
    assert found is not None
    np.testing.assert_allclose(1e6 * found.after_s, after_us - 1.0, atol=0.1)
    assert found.share(1.0 * TICK_S, 12.0).expected == pytest.approx(0.01)
    assert found.share(2.0 * TICK_S, 12.0).expected == pytest.approx(0.01)
    assert found.share(3.0 * TICK_S, 12.0).expected == 0.0


def test_a_sample_without_an_answer_counts_by_the_next() -> None:
    """A stall of four ticks: the newest is answered at once when it is over, the others would have left then."""
    tick = np.delete(np.arange(100), [50, 51, 52])
    found = lateness_of(Written(timing(tick, np.full(tick.size, 100.0))), all_answered(100, unanswered=3))
    assert found is not None
    assert found.after_s.size == 100
    np.testing.assert_allclose(1e6 * found.after_s[50:54], [849.0, 599.0, 349.0, 99.0], atol=0.1)
    assert [found.share(ticks * TICK_S, 12.0).expected for ticks in (1, 2, 3, 4)] == pytest.approx(
        [0.03, 0.02, 0.01, 0]
    )


def test_a_larger_block_takes_longer_to_observe() -> None:
    tick = np.arange(19, 2000, 20)
    found = lateness_of(Written(timing(tick, np.full(100, 1000.0), block=20, estimate_us=800.0)), all_answered(2000))
    assert found is not None
    assert found.after_s.size == 100
    assert found.share(1.5e-3, 12.0, block=20).expected == 0.0
    assert found.share(1.5e-3, 12.0, block=40).expected == 1.0  # 1 ms + 0.8 ms
    assert found.share(0.7e-3, 12.0, block=10).expected == 0.0  # 1 ms - 0.4 ms


def test_more_was_counted_than_the_wall_times_say() -> None:
    """Late on the way to the board, as the board said: in proportion; what the link lost no waiting cures."""
    after_s = np.full(10_000, 1e-4)
    after_s[:200], after_s[:100] = 3e-4, 6e-4
    found = lateness(after_s, counted=0.03, lost=0.001)
    assert found.share(TICK_S, 12.0).expected == pytest.approx(0.031)
    assert found.share(2 * TICK_S, 12.0).expected == pytest.approx(0.5 * 0.03 + 0.001)
    assert lateness(np.full(100, 1e-4), counted=0.03).share(8 * TICK_S, 12.0).expected == pytest.approx(0.03)


def test_the_interval_is_that_of_the_mean_of_a_run_to_come() -> None:
    """Of many stalls, whose pieces scatter more than chance would have it."""
    late = np.zeros((15, 400), bool)
    late[[2, 7, 11], :80:2], late[5, :160:2] = True, True
    found = lateness(np.where(late.ravel(), 3e-4, 1e-4)).share(TICK_S, 12.0)
    means = late.mean(axis=1)
    width = stats.t.ppf(0.95, 14) * means.std(ddof=1) * np.sqrt(1 / 15 + BATCH_S / 12.0)
    assert found.at_most == pytest.approx(means.mean() + width, rel=1e-6)


def test_of_what_never_happened_three_of_the_longest() -> None:
    """The rule of three: up to -ln 0.05 = 3.0 stalls (95 %), each as long as the longest that is late now."""
    after_s = np.full(6000, 1e-4)
    after_s[:40] = 3e-4
    found = lateness(after_s).share(2 * TICK_S, 12.0)
    assert found.expected == 0.0
    assert found.at_most == pytest.approx(-np.log(0.05) * 40 / 6000)


def test_few_stalls_are_bounded_by_their_number() -> None:
    """Four stalls of one answer each, for a run of no end: the exact Poisson bound of four, χ²(0.95, 10) / 2."""
    after_s = np.full(6000, 1e-4)
    after_s[[100, 300, 2000, 5000]] = 3e-4
    found = lateness(after_s).share(TICK_S, 1e9)
    assert found.expected == pytest.approx(4 / 6000)
    assert found.at_most == pytest.approx(0.5 * stats.chi2.ppf(0.95, 10) / 6000)


@pytest.mark.parametrize("stalls_per_s", [2.0, 10.0])
def test_the_upper_end_holds_for_runs_of_stalls_at_random(stalls_per_s: float) -> None:
    """A second and a half foretells twelve: at least 88 of 100 machines with stalls of 1 to 8 ms stay within."""
    rng = np.random.default_rng(7)
    kept = 0
    for _ in range(200):
        after_s = np.full(round(13.5 * RATE_HZ), 1e-4)
        for start in rng.integers(0, after_s.size - 40, rng.poisson(13.5 * stalls_per_s)):
            length = int(rng.integers(4, 33))
            after_s[start : start + length] = np.maximum(
                after_s[start : start + length], TICK_S * np.arange(length, 0, -1)
            )
        seen, to_come = after_s[:6000], after_s[6000:]
        kept += float(np.mean(to_come > TICK_S)) <= lateness(seen).share(TICK_S, 12.0).at_most
    assert kept >= 176


def test_the_smallest_latency_that_leaves_a_margin() -> None:
    """Limit 5 %, a third of it is 1.67 %: 4 % are later than a tick, 2 % than two, 1 % than three."""
    after_s = np.full(6000, 1e-4)
    for ticks, share in ((1, 0.04), (2, 0.02), (3, 0.01), (5, 0.004)):
        after_s.reshape(15, 400)[:, : round(400 * share)] = (ticks + 0.5) * TICK_S
    bench = gyro.bench(12.0, "paced", limits={"late_fraction": 0.05})
    own = machine.own_setting(bench, 1)
    found = machine.held(lateness(after_s), bench, own)
    assert found is not None
    assert (found.setting.latency_ticks, found.safely) == (3, True)
    after = machine.held(lateness(after_s), bench, own, after=found.setting)
    assert after is not None
    assert after.setting.latency_ticks == 4


def test_where_nothing_holds_nothing_is_chosen() -> None:
    bench = gyro.bench(12.0, "paced", limits={"late_fraction": 0.05})
    assert machine.held(lateness(np.full(6000, 1.0)), bench, machine.own_setting(bench, 1)) is None


def test_what_comes_with_newer_samples_is_answered_while_that_can_act(tmp_path: Path) -> None:
    """A stall of three ticks costs a board of latency 1 two answers, one of latency 4 none."""
    counted = {}
    for latency in (1, 4):
        scenario = gyro.scenario(tmp_path / f"{latency}.toml", drive={"latency_samples": latency})
        link = HandPaced(board(scenario, ClockMode.PACED), stops=dict.fromkeys(range(2000, 3000, 100), 3))
        run, counters = close_loop(link, gyro.bench(1.0, "paced"), tmp_path / f"run{latency}")
        assert run.capture is not None
        assert run.timing is not None
        counted[latency] = count_answers(
            ((piece.tick, piece.flags) for piece in run.capture.pieces()), run.timing, latency
        )
        assert counters.lost == 0
    few, none = counted[1], counted[4]
    assert few is not None
    assert none is not None
    assert few.missed >= 20
    assert none.missed == 0
