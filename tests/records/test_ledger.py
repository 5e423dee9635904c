"""The ledger of gain mode: stages of each block on one clock, found from when blocks arrived."""

from pathlib import Path

import numpy as np
import pytest

from hil.records.stream import BlockWriter
from hil.records.summary import ledger
from hil.records.timing import ledger_layout, read_timing, ticks_on_clock, timing_layout

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


def record(path: Path, deadline_us: float | None) -> None:
    """Blocks 2500 µs apart: 40 on the wire at least, 600 to estimate, 30 to send; used from the block after next on."""
    layout = ledger_layout(tick_rate_Hz=RATE_HZ, block=BLOCK, deadline_us=deadline_us)
    with BlockWriter(path, layout) as writer:
        for k in range(1, 101):
            tick = k * BLOCK - 1
            late = 2_000_000 if k == 50 else 0
            received = round(tick * 1e9 / RATE_HZ) + 40_000 + late
            applied = -1 if k == 70 else tick + BLOCK
            writer.put(tick, received, received + 630_000, 590_000, received + 600_000, applied)


def test_each_stage_has_its_time(tmp_path: Path) -> None:
    record(tmp_path / "timing.arrow", 2500.0)
    timing = read_timing(tmp_path / "timing.arrow")
    stages = timing.ledger_us
    assert len(timing.tick) == 100
    assert {len(elapsed) for elapsed in stages.values()} == {99}
    np.testing.assert_allclose(stages["wire"], [2000.0 if k == 49 else 0.0 for k in range(99)], atol=1e-3)
    np.testing.assert_allclose(stages["estimate"], 600.0)
    np.testing.assert_allclose(stages["send"], 30.0)
    np.testing.assert_allclose(stages["total"], 2500.0, atol=1e-3)
    together = stages["wire"] + stages["estimate"] + stages["send"] + stages["apply"]
    np.testing.assert_allclose(together, stages["total"], atol=1e-3)
    figures = ledger(timing)
    assert figures is not None
    assert (figures.wire.p50, figures.estimate.p999) == (pytest.approx(0.0, abs=1e-3), pytest.approx(600.0))


def test_in_lockstep_and_in_force_mode_there_is_none(tmp_path: Path) -> None:
    record(tmp_path / "timing.arrow", None)
    assert ledger(read_timing(tmp_path / "timing.arrow")) is None
    with BlockWriter(tmp_path / "force.arrow", timing_layout(tick_rate_Hz=RATE_HZ, deadline_us=10.0)) as writer:
        writer.put(0, 1, 2, 1)
    assert ledger(read_timing(tmp_path / "force.arrow")) is None
