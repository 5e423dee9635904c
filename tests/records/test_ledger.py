"""The ledger: stages of each block on one clock, found from when blocks arrived and what the board says of its time."""

from pathlib import Path

import numpy as np
import pytest

from hil.records.capture import RowFlag, board_layout, read_capture
from hil.records.clock import ClockRecord, clock_layout
from hil.records.stream import BlockWriter
from hil.records.summary import applied_ticks, ledger
from hil.records.timing import Timing, ledger_layout, rate_of_ticks, ticks_on_clock, timing_layout

RATE_HZ = 1e5
BLOCK = 250


@pytest.mark.parametrize("skew", [0.0, 80e-6, -30e-6])
def test_ticks_are_put_on_the_clock_by_the_fastest_arrivals(skew: float) -> None:
    """A device clock off by some ppm, and delays of which a few in each part of the record are short."""
    random = np.random.default_rng(3)
    tick = np.arange(1, 4001) * BLOCK - 1
    sampled = 5e12 + tick * (1.0 + skew) * 1e9 / RATE_HZ
    received = np.rint(sampled + 20e3 + random.exponential(100e3, len(tick))).astype(np.int64)
    found = ticks_on_clock(tick, received, RATE_HZ)(tick) - sampled
    assert np.abs(found - 20e3).max() < 2e3  # what every block takes at least cannot be known


def test_a_short_record_takes_the_clock_as_it_is() -> None:
    tick = np.array([249, 499, 749])
    received = np.array([2_490_000, 5_000_000, 7_500_000])
    np.testing.assert_allclose(ticks_on_clock(tick, received, RATE_HZ)(tick), [2_490_000, 4_990_000, 7_490_000])


@pytest.mark.parametrize("off", [0.0, 1e-3, -0.05])
def test_the_sample_rate_is_that_of_the_earliest_arrivals(off: float) -> None:
    """Of many records about one in twenty is outside its interval."""
    random, missed = np.random.default_rng(5), 0
    tick = np.arange(40_000)
    for _ in range(100):
        sampled = tick * 1e9 / 5000.0 / (1.0 + off)
        received = np.rint(sampled + 20e3 + random.exponential(100e3, tick.size)).astype(np.int64)
        found = rate_of_ticks(tick, received, 5000.0)
        assert found is not None
        missed += abs(found[0] - off) > found[1]
        assert found[1] < 3e-5  # a crystal
    assert missed <= 12


def test_a_sample_rate_takes_ten_arrivals() -> None:
    assert rate_of_ticks(np.arange(9), np.arange(9) * 200_000, 5000.0) is None


def record(path: Path, deadline_us: float | None) -> None:
    """Blocks 2500 µs apart: 40 on the wire at least, 600 to estimate, 30 to send; used from the block after next on."""
    layout = ledger_layout(tick_rate_Hz=RATE_HZ, block=BLOCK, deadline_us=deadline_us)
    with BlockWriter(path, layout) as writer:
        for k in range(1, 101):
            tick = k * BLOCK - 1
            late = 2_000_000 if k == 50 else 0
            received = round(tick * 1e9 / RATE_HZ) + 40_000 + late
            applied = -1 if k == 70 else tick + BLOCK
            writer.put(tick, received, received + 600_000, received + 630_000, applied)


def stages_of(timing: Timing, clock: ClockRecord | None = None) -> dict[str, np.ndarray]:
    assert timing.applied is not None
    return timing.ledger_us(timing.applied, clock)


def test_each_stage_has_its_time(tmp_path: Path) -> None:
    record(tmp_path / "timing.arrow", 2500.0)
    timing = Timing.read(tmp_path / "timing.arrow")
    stages = stages_of(timing)
    assert len(timing.tick) == 100
    assert {len(elapsed) for elapsed in stages.values()} == {99}
    np.testing.assert_allclose(stages["wire"], [2000.0 if k == 49 else 0.0 for k in range(99)], atol=1e-3)
    np.testing.assert_allclose(stages["estimate"], 600.0)
    np.testing.assert_allclose(stages["send"], 30.0)
    np.testing.assert_allclose(stages["total"], 2500.0, atol=1e-3)
    together = stages["wire"] + stages["estimate"] + stages["send"] + stages["apply"]
    np.testing.assert_allclose(together, stages["total"], atol=1e-3)
    figures = ledger(timing, None, None)
    assert figures is not None
    assert (figures.wire.p50, figures.estimate.p999) == (pytest.approx(0.0, abs=1e-3), pytest.approx(600.0))


def exchanged(path: Path, *, behind_us: float, skew: float = 0.0, first: int = 1, last: int = 100) -> ClockRecord:
    """Exchanges while blocks `first` to `last` came, `behind_us` after a tick at the least; before and after that the
    board says tick 0, whatever the time. Its clock shows an hour more at the first tick; 30 µs there, 30 back.
    """
    with BlockWriter(path, clock_layout(tick_rate_Hz=RATE_HZ)) as writer:
        for k in [*range(-40, 0, 4), *range(4 * first, 4 * last), *range(4 * last + 40, 4 * last + 80, 4)]:
            tick = (k * BLOCK) // 4 + 17
            reading = tick * 1e9 / RATE_HZ + 1e3 * behind_us + 900.0 * (k % 7)
            streaming = 4 * first <= k < 4 * last
            board = 3_600_000_000_000 + round(reading * (1.0 + skew))
            # The host's clock shows a second at the first tick.
            sent, received = 1_000_000_000 + round(reading - 30e3), 1_000_000_000 + round(reading + 30e3)
            writer.put(tick if streaming else 0, sent, board, received)
    return ClockRecord.read(path)


@pytest.mark.parametrize("skew", [0.0, 2e-4])
def test_the_boards_own_word_leaves_the_wire_its_time(tmp_path: Path, skew: float) -> None:
    """Every block takes 40 µs on the wire, which arrivals alone cannot tell; the board answers 5 µs after a tick."""
    path = tmp_path / "timing.arrow"
    with BlockWriter(path, ledger_layout(tick_rate_Hz=RATE_HZ, block=BLOCK, deadline_us=2500.0)) as writer:
        for k in range(1, 101):
            tick = k * BLOCK - 1
            received = 1_000_000_000 + round(tick * 1e9 / RATE_HZ) + 40_000
            writer.put(tick, received, received + 600_000, received + 630_000, tick + BLOCK)
    timing = Timing.read(path)
    np.testing.assert_allclose(stages_of(timing)["wire"], 0.0, atol=1e-3)
    clock = exchanged(tmp_path / "clock.arrow", behind_us=5.0, skew=skew)
    stages = stages_of(timing, clock)
    np.testing.assert_allclose(stages["wire"], 35.0, atol=0.1)
    np.testing.assert_allclose(stages["total"], 2500.0, atol=1e-3)
    np.testing.assert_allclose(stages["apply"], 2500.0 - 35.0 - 630.0, atol=0.1)
    # What the board says later than its blocks arrive tells nothing new.
    clock = exchanged(tmp_path / "late.arrow", behind_us=300.0)
    np.testing.assert_allclose(stages_of(timing, clock)["wire"], 0.0, atol=1e-3)


def test_in_lockstep_there_is_none(tmp_path: Path) -> None:
    record(tmp_path / "timing.arrow", None)
    assert ledger(Timing.read(tmp_path / "timing.arrow"), None, None) is None


def test_in_force_mode_the_next_row_tells_whether_an_answer_acted(tmp_path: Path) -> None:
    """Latency 1: what answers tick m acts from m + 1, of which row m + 2 tells. That of 5 was held off, that of 9
    lost."""
    latency = 1
    with BlockWriter(tmp_path / "timing.arrow", timing_layout(tick_rate_Hz=1e4, deadline_us=100.0)) as writer:
        for tick in range(20):
            received = 7_000_000 + tick * 100_000 + (3_000 if tick % 2 else 0)
            writer.put(tick, received, received + 20_000, received + 30_000)
    layout = board_layout(tick_rate_Hz=1e4, axes=2, latency_ticks=latency, sense_scale_V=1e-5, drive_scale=1e-3)
    with BlockWriter(tmp_path / "capture.arrow", layout) as writer:
        for tick in range(20):
            if tick != 11:
                writer.put(tick, 0, 0, 0, 0, RowFlag.LATE_ANSWER_HELD if tick == 7 else 0)
    timing, capture = Timing.read(tmp_path / "timing.arrow"), read_capture(tmp_path / "capture.arrow")
    applied = applied_ticks(timing.tick, capture)
    unknown = {5, 9, 18, 19}
    assert applied.tolist() == [-1 if tick in unknown else tick + latency for tick in range(20)]
    figures = ledger(timing, capture, None)
    assert figures is not None
    assert figures.wire.p50 == pytest.approx(0.0, abs=3.0)
    assert (figures.estimate.p50, figures.send.p50) == (pytest.approx(20.0), pytest.approx(10.0))
    assert figures.total.p999 == pytest.approx(100.0, abs=0.5)
    assert ledger(timing, None, None) is None
