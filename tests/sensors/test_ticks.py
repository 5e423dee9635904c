"""Sample numbers from a short counter: steps, gaps, whole turns missing, and a host that looked late."""

import pytest

from hil.sensors.adapter import Sample
from hil.sensors.ticks import TickCounter

RATES_HZ = (125.0, 250.0, 500.0, 1000.0, 2000.0)
RATE_HZ = 500.0


def samples(ticks: range, step: int = 4) -> list[Sample]:
    return [Sample(tick * step % 256, (tick, 0, 0), 0, 0) for tick in ticks]


def number(*batches: tuple[range, float], step: int = 4) -> list[int]:
    """Ticks given to samples that came in batches at those times; each sample carries its true tick."""
    counter = TickCounter(256, RATES_HZ)
    numbered = [row for ticks, now_s in batches for row in counter.number(samples(ticks, step), now_s)]
    assert counter.step == step
    assert counter.sample_rate_Hz == RATE_HZ
    first = numbered[0][1].codes[0]
    assert [tick + first for tick, _ in numbered] == [sample.codes[0] for _, sample in numbered]
    return [tick for tick, _ in numbered]


START = [(range(50), 0.1), (range(50, 300), 0.6)]


@pytest.mark.parametrize("step", [1, 4, 16])
def test_samples_in_a_row(step: int) -> None:
    batches = [(range(n, n + 10), n / RATE_HZ) for n in range(0, 500, 10)]
    assert number(*batches, step=step) == list(range(500))


def test_step_and_rate_are_learned_from_the_first_samples() -> None:
    counter = TickCounter(256, RATES_HZ)
    assert counter.number(samples(range(40)), 0.1) == []
    assert counter.number(samples(range(40, 260)), 0.54) == []
    assert counter.sample_rate_Hz == 0.0
    assert len(counter.number(samples(range(260, 300)), 0.62)) == 300
    assert counter.sample_rate_Hz == 500.0


def test_a_sensor_that_is_triggered_from_outside_has_any_rate() -> None:
    counter = TickCounter(256, RATES_HZ)
    for n in range(20):
        counter.number(samples(range(12 * n, 12 * n + 12), 1), 0.04 * n)
    assert counter.sample_rate_Hz == pytest.approx(300.0)


def test_gaps_shorter_than_a_turn() -> None:
    assert number(*START, (range(303, 310), 0.62), (range(350, 370), 0.74))[-1] == 369


@pytest.mark.parametrize("missing", [63, 64, 65, 128, 500])
def test_whole_turns_are_told_by_the_clock(missing: int) -> None:
    end = 300 + missing + 50
    assert number(*START, (range(300 + missing, end), end / RATE_HZ))[-1] == end - 1


def test_a_host_that_looked_late_invents_no_gap() -> None:
    assert number(*START, (range(300, 1100), 2.2), (range(1100, 1110), 2.22))[-1] == 1109


def test_samples_lost_while_the_step_is_learned() -> None:
    assert number((range(50), 0.1), (range(53, 200), 0.4), (range(220, 310), 0.62))[50] == 53


def test_a_clock_whose_counts_do_not_fit_the_rate_tells_a_long_gap() -> None:
    """800 samples a second of a clock of 10 kHz: 12 or 13 counts each."""
    ticks = [n for n in range(400) if not 200 <= n < 250]
    counter = TickCounter(1 << 32, (400.0, 800.0, 1000.0), 1e4)
    numbered = counter.number([Sample(n * 25 // 2, (), 0, 0) for n in ticks], 1.0)
    assert counter.sample_rate_Hz == 800.0
    assert [tick for tick, _ in numbered] == ticks
