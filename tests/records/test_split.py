"""Which part of a record is traced, and which of it is held out."""

import numpy as np
import pytest

from estimator.record import Record
from estimator.settings import Device
from hil.records.capture import Capture
from hil.tracing.trace import Part, moving, parts_of, sample_of

RATE = 1000.0
DEVICE = Device(
    sample_rate=RATE, stiffness=((2.0 * np.pi * 50.0) ** 2,), damping=(1.0,), amplitude=1e-4, sense_gain=(-890.0,),
    noise=(1e-4,),
)  # fmt: skip


def ended(at: int, samples: int, lost: int = 0) -> Part:
    """A decay that stops at a sample, of a clocked record whose first rows were lost after the very first."""
    rows = np.arange(samples)
    sense = np.where(rows < at, np.sin(2.0 * np.pi * 50.0 * rows / RATE), 0.0)
    sense += np.random.default_rng(1).normal(0.0, 1e-4, samples)
    tick = np.concatenate([[0], np.arange(1 + lost, samples)]) + 7_000
    header = {"tick_rate_Hz": RATE, "axes": 1, "uniform": True, "segments": {}, "columns": {}}
    captured = Capture({"tick": tick}, header, True)
    record = Record(sense[:, None], np.zeros((samples, 1, 1)), np.full(samples, 1.0 / RATE))
    _, held_out = parts_of(captured, None)
    return Part(captured, record, sample_of(captured, held_out), ("imported",))


@pytest.mark.parametrize("lost", [0, 60])
def test_what_follows_rest_goes_and_what_is_left_is_split_anew(lost: int) -> None:
    part = moving(ended(1010, 9000, lost), DEVICE)
    assert len(part.record) == 1000  # two cycles are forty samples
    assert len(part.captured) == 1000 - lost
    assert part.captured.tick[-1] - part.captured.tick[0] == 999
    assert part.split == pytest.approx(lost + 0.6 * (1000 - lost), abs=1.0)
    assert part.said[0] == "imported"
    assert part.said[1].startswith("the motion has come to rest at 0.999 s: the 8000 samples after that are not used")


@pytest.mark.parametrize(("at", "samples"), [(5500, 9000), (300, 9000), (9000, 9000)])
def test_a_part_that_shows_motion_or_is_all_there_is_stays(at: int, samples: int) -> None:
    """Held out from 5400 on; of 280 samples a part of 112 would be too short."""
    part = ended(at, samples)
    assert moving(part, DEVICE) is part
