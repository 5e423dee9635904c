"""Where exactly a record is refused, and which number its words advise."""

import re
from dataclasses import replace

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device
from estimator.trace import fitness
from estimator.trace.fitness import longest_stand, reached_at_speed, remarks

RATE, HZ = 4000.0, 200.0
TARGET = (2.0 * np.pi * HZ) ** 2
GYRO = Device(
    sample_rate=RATE, stiffness=(TARGET, TARGET, 0.0), damping=(1.0, 1.0, 0.0), amplitude=1e-4,
    sense_gain=(-890.0, -890.0), noise=(1e-4, 3e-4),
)  # fmt: skip
SINGLE = replace(GYRO, stiffness=(TARGET,), damping=(1.0,), sense_gain=(-890.0,), noise=(1e-4,))
RNG = np.random.default_rng(1)


def record(samples: int, axes: int = 2, *, rate: float = RATE, driven: bool = True) -> Record:
    sense = np.sin(2.0 * np.pi * 30.0 * np.arange(samples) / rate)[:, None] * np.ones(axes)
    return Record(sense, np.full((samples, axes, 1), float(driven)), np.full(samples, 1.0 / rate))


def refused(check: object, *given: object) -> str | None:
    try:
        check(*given)  # type: ignore[operator]
    except ModelError as error:
        return str(error)
    return None


@pytest.mark.parametrize(("lost", "said"), [(50, None), (51, "51% of the samples are lost; mend the link")])
def test_more_than_half_may_not_be_lost(lost: int, said: str | None) -> None:
    """A sample is lost where one of its channels is."""
    seen = record(100)
    seen.sense[:lost, 1] = np.nan
    told = refused(fitness._require_numbers, seen)
    assert told is None if said is None else (told or "").startswith(said)
    assert refused(fitness._require_numbers, record(0)) is None


@pytest.mark.parametrize(
    ("samples", "split", "driven", "axes", "said"),
    [
        (5000, 3000, True, 2, None),  # 20 samples a cycle: 150 cycles, and 100
        (5000, 3001, True, 2, "held out has 1999 samples, "),
        (5000, 3020, True, 2, "held out has 1980 samples, 99 cycles of the resonance; record 1.3 s or longer"),
        (5000, 1980, True, 2, "fitted has 1980 samples, 99 cycles of the resonance; record 1.3 s or longer"),
        (300, 150, False, 2, None),  # a free response: 7.5 cycles of each
        (300, 149, False, 2, "fitted has 149 samples, 7.45 cycles of the resonance; record 0.076 s"),
        (300, 151, False, 2, "held out has 149 samples, 7.45 cycles of the resonance; record 0.076 s"),
        (300, 150, True, 1, None),  # a single axis is asked for samples only
        (300, 149, True, 1, "fitted has 149 samples"),
        (300, 300, True, 1, "held out has 0 samples, 0 cycles of the resonance; hold less of it out"),
    ],
)
def test_both_parts_must_be_long_enough_and_the_advice_is_for_the_shorter(
    samples: int, split: int, axes: int, said: str | None, *, driven: bool
) -> None:
    device = SINGLE if axes == 1 else GYRO
    told = refused(fitness.require_length, record(samples, axes, driven=driven), device, split)
    if said is None:
        assert told is None
    else:
        assert told is not None
        assert told.startswith("too short: the part to be ")
        assert said in told


def test_a_response_to_one_push_is_driven() -> None:
    pushed = record(300, driven=False)
    pushed.drive[17] = 1e-3
    told = refused(fitness.require_length, pushed, GYRO, 150)
    assert told is not None
    assert "fitted has 150 samples, 7.5 cycles of the resonance" in told


def test_a_free_response_of_few_cycles_is_told_how_long_it_should_be() -> None:
    """Five cycles of each part, sampled a hundred times a cycle."""
    told = refused(fitness.require_length, record(900, driven=False, rate=20_000.0), GYRO, 500)
    assert told is not None
    assert "held out has 400 samples, 4 cycles of the resonance; record 0.057 s or longer" in told
    assert refused(fitness.require_length, record(1000, driven=False, rate=20_000.0), GYRO, 500) is None


def test_a_device_without_a_resonance_is_asked_for_samples_only() -> None:
    still = replace(GYRO, stiffness=(0.0, 0.0, 0.0), target_stiffness=0.0)
    told = refused(fitness.require_length, record(100, driven=False), still, 50)
    assert told is not None
    assert told.endswith("record 0.076 s or longer")  # of 150 samples


@pytest.mark.parametrize(("rate", "said"), [(800.0, False), (799.0, True), (780.0, True)])
def test_four_samples_a_cycle_of_the_declared_resonance_are_needed(rate: float, *, said: bool) -> None:
    told = refused(fitness._require_samples_per_cycle, record(1000, rate=rate), GYRO)
    assert (told is not None) is said
    if rate == 780.0:
        assert told == (
            "sampled too slowly: 3.9 samples a cycle of 200 Hz, the declared resonance; record at 800 Hz or faster, "
            "best at 20 samples a cycle"
        )


@pytest.mark.parametrize(("samples", "seen"), [(160, True), (150, True), (149, False)])
def test_of_a_record_of_fewer_than_150_samples_no_line_is_sought(samples: int, *, seen: bool) -> None:
    t = np.arange(samples) / RATE
    fast = replace(record(samples), sense=np.sin(2.0 * np.pi * 1500.0 * t)[:, None] * np.ones(2))
    told = refused(fitness._require_samples_per_cycle, fast, GYRO)
    assert (told is not None) is seen
    assert told is None or "the record's strongest line" in told


@pytest.mark.parametrize(("share", "seen"), [(0.09, False), (0.14, True)])
@pytest.mark.parametrize("offset", [0.0, 50.0])
def test_the_strongest_line_holds_a_tenth_of_the_power_of_all_channels(
    share: float, offset: float, *, seen: bool
) -> None:
    """Within two bins to either side; neither a mean nor lost samples count."""
    n = 4000
    wave = np.sin(2.0 * np.pi * 700.0 * np.arange(n) / RATE)
    sense = offset + np.random.default_rng(4).standard_normal((n, 2))
    sense[:, 1] += 2.0 * np.sqrt(share / (1.0 - share)) * wave
    sense[5, 0] = np.nan
    assert fitness._strongest(sense, RATE) == (pytest.approx(700.0) if seen else 0.0)


@pytest.mark.parametrize(("share", "seen"), [(0.107, True), (0.097, False)])
def test_of_a_line_all_of_its_lobe_counts(share: float, *, seen: bool) -> None:
    """A Hann window leaves a sixth of it in the bin to either side: 0.107 of the power, beside ten of 0.089."""
    t = np.arange(4000) / RATE
    rest = np.sqrt((1.0 - share) / 10.0)
    sense = sum(rest * np.sin(2.0 * np.pi * (100.0 + 130.0 * k) * t + k) for k in range(10))
    sense = sense + np.sqrt(share) * np.sin(2.0 * np.pi * 1777.0 * t)
    assert fitness._strongest(sense[:, None], RATE) == (pytest.approx(1777.0) if seen else 0.0)


def test_a_line_at_the_lowest_frequency_is_one_all_the_same() -> None:
    sense = np.sin(2.0 * np.pi * np.arange(1000) / 1000.0)[:, None]
    assert fitness._strongest(sense, 1000.0) == pytest.approx(1.0)


# -- tops -------------------------------------------------------------------------------------------------------------


def codes(end: int, beside: tuple[int, ...], samples: int = 10_000, *, fast: bool = True) -> Array:
    """Whole numbers: so many at the highest, and at each of those below it; the rest far below, each once.

    fast: the highest is run into, from far below; else it is come to and left by single codes.
    """
    tops = [100.0] * end
    rest = [100.0 - 1 - at for at, count in enumerate(beside) for _ in range(count)]
    far = -np.arange(1.0, samples - len(tops) - len(rest) + 1)
    series = list(far[: len(far) // 2])
    series += [10.0, 40.0, 70.0, 90.0] if fast else [97.0, 98.0, 99.0, 99.0]
    series += tops + rest + list(far[len(far) // 2 :])
    return np.array(series)


@pytest.mark.parametrize(
    ("end", "beside", "clipped"),
    [
        (20, (1, 1, 1, 1, 1), False),  # not more than twenty
        (21, (1, 1, 1, 1, 1), True),
        (30, (6, 6, 6, 6, 6), False),  # five times what is beside it
        (31, (6, 6, 6, 6, 6), True),
        (31, (10, 2, 6, 6, 6, 90), True),  # the five next to it count, and no more
        (31, (10, 10, 6, 6, 6), False),
        (10, (0, 0, 0, 0, 0), False),
    ],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_crowded_end_has_over_twenty_and_five_times_its_neighbours(
    monkeypatch: pytest.MonkeyPatch, end: int, beside: tuple[int, ...], side: float, *, clipped: bool
) -> None:
    monkeypatch.setattr(fitness, "reached_at_speed", lambda values, code: True)
    told = refused(fitness._require_whole_tops, side * codes(end, beside), "sense channel y")
    assert (told is not None) is clipped
    if told:
        share = f"{end / len(codes(end, beside)):.2%}"
        assert told.startswith(f"sense channel y is clipped: {share} of the samples lie at the end of the scale")


@pytest.mark.parametrize(("samples", "clipped"), [(29_000, True), (31_100, False)])
def test_what_is_less_than_a_thousandth_is_let_through(
    monkeypatch: pytest.MonkeyPatch, samples: int, *, clipped: bool
) -> None:
    monkeypatch.setattr(fitness, "reached_at_speed", lambda values, code: True)
    told = refused(fitness._require_whole_tops, codes(30, (1, 1, 1, 1, 1), samples), "x")
    assert (told is not None) is clipped


@pytest.mark.parametrize(("farthest", "crowded"), [(26, False), (25, True)])
def test_an_end_is_held_against_the_five_codes_beside_it(
    monkeypatch: pytest.MonkeyPatch, farthest: int, crowded: bool
) -> None:
    """Thirty at the end are five times the mean of 26, 1, 1, 1, 1; the sixth code does not count."""
    monkeypatch.setattr(fitness, "reached_at_speed", lambda values, code: True)
    codes = np.repeat(np.arange(8.0), [40, 99, farthest, 1, 1, 1, 1, 30])
    assert (refused(fitness._require_whole_tops, codes, "x") is not None) is crowded


def test_both_ends_together_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fitness, "reached_at_speed", lambda values, code: True)
    series = codes(30, (1, 1, 1, 1, 1), 45_000)
    series = np.concatenate([series, [-1e6] * 30])
    assert refused(fitness._require_whole_tops, series[series != -1e6], "x") is None
    assert refused(fitness._require_whole_tops, series, "x") is not None


def test_an_unreached_end_and_an_empty_channel_are_no_clipping(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []
    monkeypatch.setattr(fitness, "reached_at_speed", lambda values, code: asked.append(code) or False)
    assert refused(fitness._require_whole_tops, 0.5 * codes(40, (1, 1, 1, 1, 1)), "x") is None
    assert asked == [0.5]  # the usual distance of two codes
    assert refused(fitness._require_whole_tops, np.zeros(0), "x") is None
    assert refused(fitness._require_whole_tops, np.zeros(90), "x") is None  # one value has nothing beside it


def wave(level: float, samples: int = 6000, per_cycle: float = 200.0) -> Array:
    """A sine of a thousand codes that is cut off at a level."""
    swing = np.round(1000.0 * np.sin(2.0 * np.pi * np.arange(samples) / per_cycle + 0.1))
    return np.minimum(swing, np.round(level))


def held(samples: int = 6000) -> Array:
    """A sine that comes to rest at its top for a tenth of a cycle."""
    phase = np.arange(samples) % 220
    return np.round(1000.0 * np.sin(2.0 * np.pi * np.where(phase < 50, phase, np.maximum(phase - 20, 50)) / 200.0))


def test_a_wall_is_run_into_and_a_rest_is_come_to() -> None:
    assert reached_at_speed(wave(700.0), 1.0)
    assert reached_at_speed(wave(950.0), 1.0)
    assert not reached_at_speed(held(), 1.0)
    assert not reached_at_speed(wave(2000.0), 1.0)


@pytest.mark.parametrize(("slope", "at_speed"), [(0.4, False), (1.1, True)])
def test_run_into_is_what_would_have_gone_on_by_more_than_two_codes(slope: float, *, at_speed: bool) -> None:
    """A straight line to its end, and three samples there: after them it would be 3 slopes on, the end itself taken."""
    rise = 100.0 - slope * np.arange(30.0, 0.0, -1.0)
    series = np.concatenate([rise, [100.0] * 3, rise[::-1]])
    assert reached_at_speed(series, 1.0) is at_speed
    assert reached_at_speed(series, 0.2)
    assert not reached_at_speed(series, 5.0)
    assert not reached_at_speed(series[-33:], 1.0)  # an end at the beginning of the record was not come to


def test_half_of_the_stretches_must_be_run_into() -> None:
    fast, slow = 100.0 - 3.0 * np.arange(30.0, 0.0, -1.0), 100.0 - 0.1 * np.arange(30.0, 0.0, -1.0) ** 2
    top = [100.0] * 4
    wall = np.concatenate([fast, top, fast[::-1]])
    rest = np.concatenate([slow, top, slow[::-1]])
    assert reached_at_speed(np.concatenate([wall, wall, rest]), 1.0)
    assert not reached_at_speed(np.concatenate([wall, rest, rest]), 1.0)


def test_of_a_long_stretch_as_much_is_looked_at_as_before_it() -> None:
    """Twenty samples at most, four at least."""
    seen, ahead = [], []
    own, carried_on = np.polyfit, np.polyval

    def polyfit(at: Array, values: Array, degree: int) -> Array:
        seen.append((len(at), degree))
        return own(at, values, degree)

    def polyval(parabola: Array, at: Array) -> Array:
        ahead.append(at.tolist())
        return np.asarray(carried_on(parabola, at))

    rise = 100.0 - np.arange(60.0, 0.0, -1.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np, "polyfit", polyfit)
        patch.setattr(np, "polyval", polyval)
        for stand in (1, 9, 50):
            reached_at_speed(np.concatenate([rise, [100.0] * stand, rise[::-1]]), 1.0)
        reached_at_speed(np.tile([*rise, 100.0], 300), 1.0)
    assert seen[:3] == [(4, 2), (9, 2), (20, 2)]
    assert ahead[:3] == [[0], [*range(9)], [*range(20)]]  # carried on over the stretch, and no farther than that
    assert len(seen) == 3 + 200  # of many stretches the first two hundred


# -- what is odd ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("series", "most"), [([1, 1, 1], 3), ([1, 2, 3], 1), ([1, 2, 2, 2, 3, 3], 3), ([5, 5, 1, 0, 0, 0, 0], 4)]
)
def test_the_longest_stand_is_the_most_samples_in_a_row_that_are_equal(series: list[int], most: int) -> None:
    assert longest_stand(np.array(series, float)) == most


def said(series: Array, noise: float = 1e-4) -> tuple[str, ...]:
    device = replace(SINGLE, noise=(noise,))
    n = len(series)
    return remarks(Record(series[:, None], np.ones((n, 1, 1)), np.full(n, 1.0 / RATE)), device)


def test_coarse_are_codes_whose_rounding_is_more_than_the_declared_noise() -> None:
    """A code's rounding is 1/√12 of it."""
    swing = np.sin(0.3 * np.arange(2000))
    for code, told in ((1.01 * np.sqrt(12.0) * 1e-2, True), (0.99 * np.sqrt(12.0) * 1e-2, False)):
        found = said(np.round(swing / code) * code, noise=1e-2)
        assert bool(found) is told
        if told:
            assert re.search(r"codes of 0\.035 V, which is a noise of 0\.0101 V by itself", found[0])
            assert found[0].endswith("declare that much at least, not 0.01 V")


@pytest.mark.parametrize(("stand", "told"), [(20, False), (21, True)])
def test_what_stands_still_for_more_than_twenty_samples_is_held(stand: int, *, told: bool) -> None:
    series = np.concatenate([RNG.standard_normal(500), np.full(stand, 7.0), RNG.standard_normal(500)])
    series[3] = np.nan
    found = said(series, noise=1.0)
    assert found == (
        (f"sense channel x stands still for up to {stand} samples at a time: it is held, and not clipped",)
        if told
        else ()
    )


def test_a_signal_that_changes_now_and_then_only_is_not_held_by_that() -> None:
    """Every tenth sample is new: four of its steps are forty samples."""
    slow = np.repeat(RNG.standard_normal(200), 10)
    for stand, told in ((36, False), (46, True)):
        series = np.concatenate([slow, np.full(stand, 7.0), slow])
        assert bool(said(series, noise=1.0)) is told
    assert said(np.full(400, 3.0)) == ()  # what never moves is not held: it is refused elsewhere


@pytest.mark.parametrize(("samples", "told"), [(149, False), (150, True)])
def test_of_few_samples_nothing_is_remarked(samples: int, *, told: bool) -> None:
    series = np.concatenate([RNG.standard_normal(samples - 50), np.full(50, 7.0)])
    assert bool(said(series, noise=1.0)) is told


@pytest.mark.parametrize(("sizes", "refuses"), [((2.9, 2.9), True), ((2.9, 3.1), False), ((3.1, 0.1), False)])
def test_nothing_moves_where_no_channel_exceeds_three_times_its_noise(
    sizes: tuple[float, float], *, refuses: bool
) -> None:
    signs = np.where(np.arange(1000)[:, None] % 2, 1.0, -1.0)
    sense = signs * np.array(sizes) * np.array(GYRO.noise) + 5.0
    sense[7] = np.nan
    told = refused(fitness._require_excitation, replace(record(1000), sense=sense), GYRO)
    assert (told is not None) is refuses
    if told:
        assert told.startswith(
            "nothing moves: 0.00087 V rms where the declared noise is 0.0003 V; record with the drive on"
        )


def test_a_wall_is_seen_where_the_record_has_just_enough_before_it():
    """As many samples as a parabola takes; with one less there is none."""
    rising = -20.0 * np.arange(4.0, 0.0, -1.0)
    stand = np.zeros(4)
    fall = rising[::-1]
    assert reached_at_speed(np.concatenate([rising, stand, fall]), 1.0)
    assert not reached_at_speed(np.concatenate([rising[1:], stand, fall]), 1.0)
