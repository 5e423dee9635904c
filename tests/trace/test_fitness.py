"""Records that cannot be traced are refused with what to record instead; all others are let through."""

import re

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.record import Record
from estimator.settings import Device
from estimator.trace.traceable import remarks, require_traceable

RATE, RESONANCE, VOLTS, NOISE = 4000.0, 200.0, 0.089, 9e-5
DEVICE = Device(
    sample_rate=RATE,
    stiffness=((2 * np.pi * RESONANCE) ** 2,) * 2 + (0.0,),
    damping=(1.0, 1.0, 0.0),
    amplitude=1e-4,
    sense_gain=(-890.0, -890.0),
    noise=(NOISE, NOISE),
)


def ride(
    seconds: float = 3.0, rate: float = RATE, frequency: float = RESONANCE, volts: float = VOLTS, driven: bool = True
) -> Record:
    n = round(seconds * rate)
    t = np.arange(n) / rate
    random = np.random.default_rng(1)
    swing = volts * (1 + 0.3 * np.sin(2 * np.pi * t)) * np.cos(2 * np.pi * frequency * t)
    sense = swing[:, None] * np.stack([np.cos(3 * t), np.sin(3 * t)], axis=1) + NOISE * random.standard_normal((n, 2))
    drive = random.standard_normal((n, 2, 1)) if driven else np.zeros((n, 2, 1))
    return Record(np.round(sense / 7.6e-6) * 7.6e-6, drive, np.full(n, 1 / rate))


def check(record: Record, device: Device = DEVICE, fraction: float = 0.6) -> None:
    require_traceable(record, device, round(fraction * len(record)))


@pytest.mark.parametrize(
    "record", [ride(), ride(seconds=0.3, driven=False), ride(volts=20 * NOISE), ride(rate=900.0, frequency=200.0)]
)
def test_what_can_be_traced_is_let_through(record: Record) -> None:
    check(record)


def test_coarse_codes_are_not_clipping() -> None:
    """Eight codes up, eight down: the highest is common by nature."""
    record = ride()
    check(Record(np.round(record.sense / 0.012) * 0.012, record.drive, record.step))


@pytest.mark.parametrize(
    ("record", "says"),
    [
        (ride(seconds=0.01, driven=False), r"too short: .* record 0\.095 s or longer"),
        (
            ride(seconds=0.045, rate=20_000.0, driven=False),
            r"too short: .* 360 samples, 3\.6 cycles of the resonance; record",
        ),
        (ride(volts=1e-5), r"nothing moves: .* record with the drive on"),
        (ride(rate=700.0), r"3\.5 samples a cycle of 200 Hz, the declared resonance; record at 800 Hz or faster"),
        (
            ride(frequency=1200.0),
            r"3\.33 samples a cycle of 1200 Hz, the record's strongest line; record at 4\.8e\+03 Hz",
        ),
    ],
)
def test_what_cannot_is_refused_with_what_to_do(record: Record, says: str) -> None:
    with pytest.raises(ModelError) as caught:
        check(record)
    assert re.search(says, str(caught.value)), str(caught.value)


@pytest.mark.moderate
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_clipped_record_is_refused(side: float) -> None:
    record = ride()
    sense = record.sense.copy()
    sense[:, 1] = side * np.minimum(side * sense[:, 1], 0.8 * VOLTS)
    with pytest.raises(ModelError, match=r"sense channel y is clipped: .* smaller amplitude"):
        check(Record(sense, record.drive, record.step))


def test_a_record_with_more_holes_than_samples_is_refused() -> None:
    record = ride()
    sense = record.sense.copy()
    sense[: 2 * len(sense) // 3, 1] = np.nan  # one channel lost is a sample lost
    with pytest.raises(ModelError, match="67% of the samples are lost"):
        check(Record(sense, record.drive, record.step))


def test_a_record_of_which_nothing_is_held_out_is_refused() -> None:
    with pytest.raises(ModelError, match=r"held out has 0 samples, .*; hold less of it out"):
        check(ride(), fraction=1.0)


def test_the_advised_length_is_enough() -> None:
    with pytest.raises(ModelError) as caught:
        check(ride(seconds=0.07))
    advised = re.search(r"record ([\d.]+) s", str(caught.value))
    assert advised is not None
    check(ride(seconds=1.05 * float(advised.group(1))))


SLOW = Device(sample_rate=1000.0, stiffness=(400.0,), damping=(1.0,), amplitude=1.0, sense_gain=(1.0,), noise=(1e-4,))


def held_by_friction(code: float) -> Record:
    """A driven mass that a friction of 3 m/s² holds at every turning point, told in codes; by small steps of Euler's
    scheme, with Karnopp's rule."""
    samples, parts = 12000, 20
    x, v, seen, u = 0.0, 0.0, np.zeros(samples), np.zeros(samples)
    for m in range(samples):
        u[m] = 5.0 * np.sin(2 * np.pi * 0.5 * m / 1000.0)
        for _ in range(parts):
            free = u[m] - 400.0 * x - 20.0 * v
            if v == 0.0 and abs(free) <= 3.0:
                continue
            before = v
            v += (free - 3.0 * (np.sign(v) or np.sign(free))) / 1000.0 / parts
            v = 0.0 if before * v < 0.0 else v
            x += v / 1000.0 / parts
        seen[m] = round(x / code) * code
    return Record(seen[:, None], u[:, None, None], np.full(samples, 1e-3))


@pytest.mark.moderate
def test_what_stands_still_is_not_clipped() -> None:
    """It lies at its ends half of the time, and comes to rest there."""
    record = held_by_friction(1e-5)
    assert np.mean(record.sense == record.sense.max()) > 0.01, "the end is crowded"
    require_traceable(record, SLOW, 7000)
    (said,) = remarks(record, SLOW)
    assert "stands still" in said
    assert "not clipped" in said


@pytest.mark.moderate
def test_the_same_mass_before_a_wall_is_clipped() -> None:
    record = held_by_friction(1e-5)
    cut = np.minimum(record.sense, 0.6 * record.sense.max())
    with pytest.raises(ModelError, match="is clipped"):
        require_traceable(Record(cut, record.drive, record.step), SLOW, 7000)


def test_coarse_codes_are_told_with_their_noise() -> None:
    record = ride()
    said = remarks(Record(np.round(record.sense / 0.012) * 0.012, record.drive, record.step), DEVICE)
    assert len(said) == 2
    assert "codes of 0.012 V" in said[0]
    assert "noise of 0.00346 V" in said[0]
    assert remarks(record, DEVICE) == ()


def test_samples_on_no_grid_have_no_codes() -> None:
    """Volts that are large for the declared noise: neighbours of the sorted samples lie farther apart than it."""
    random = np.random.default_rng(2)
    record = ride()
    sense = 1000.0 * (record.sense + NOISE * random.standard_normal(record.sense.shape))
    assert np.median(np.diff(np.unique(sense[:, 0]))) > np.sqrt(12.0) * NOISE
    assert remarks(Record(sense, record.drive, record.step), DEVICE) == ()
