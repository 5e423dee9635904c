"""What a rate reference says (docs/reference/trace.md, checks), on estimates that are made up."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.diagnosis import Fit
from estimator.trace.reference import _random_walk, departures
from tests.trace.plain import RATE, problem, records

N, SPLIT = 1000, 400
NOISE = 2e-3


def examined(rate_error: float | None, angle_error: float | None, rate: float = 0.0, sure: float = 0.01) -> Any:
    fit = Fit((1.0,), (1.0,), 1.0, 0.5, None, angle_error, rate_error)
    estimates = SimpleNamespace(
        of=lambda name: np.full(N, rate), index=np.arange(N), angle_deviation=np.full(N, sure)
    )  # fmt: skip
    return SimpleNamespace(held_out=fit, estimates=estimates)


def asked(before: Any, after: Any, *, reference: bool = True) -> dict[str, tuple[float, bool]]:
    sense, drive = records(1, N)
    given = problem(sense[0], drive[0])
    if reference:
        noise = NOISE * np.random.default_rng(2).standard_normal(N)
        given = replace(given, record=replace(given.record, channels={"rate": noise}))
    return {one.what: (one.allowed, one.after <= one.allowed) for one in departures(given, before, after, SPLIT)}


def test_an_angle_may_be_off_by_its_and_the_reference_s_deviation() -> None:
    """2.6 × √(deviation² + random walk²), the walk that of noise on every sample."""
    walk = NOISE / RATE * np.sqrt(N - SPLIT)
    allowed, passed = asked(examined(0.1, 0.011), examined(0.1, 0.02))["angle"]
    assert allowed == pytest.approx(2.6 * np.hypot(0.01, walk), rel=0.01)
    assert passed
    assert not asked(examined(0.1, 0.011), examined(0.1, 0.03))["angle"][1]


@pytest.mark.parametrize(("after", "passes"), [(0.69, True), (0.72, False)])
def test_or_half_of_the_power_beyond_that_goes(after: float, passes: bool) -> None:
    assert asked(examined(0.1, 1.0), examined(0.1, after))["angle"][1] is passes


@pytest.mark.parametrize(("after", "passes"), [(0.1, True), (0.1001, True), (0.13, False)])
def test_a_rate_must_not_become_worse_but_for_chance(after: float, passes: bool) -> None:
    """It is moved by 1 mrad/s: 2 · 1.96 · e δ / √n at most, n the memories in the part held out, one here."""
    allowed, passed = asked(examined(0.1, 0.01), examined(after, 0.01, rate=1e-3))["rate"]
    assert allowed == pytest.approx(np.sqrt(0.1**2 + 2.0 * 1.96 * 0.1 * 1e-3), rel=1e-4)
    assert passed is passes


def test_without_a_reference_or_an_error_nothing_is_said() -> None:
    assert asked(examined(0.1, 0.1), examined(0.1, 9.0), reference=False) == {}
    assert asked(examined(None, None), examined(0.1, 0.1)) == {}
    assert set(asked(examined(0.1, None), examined(0.1, None))) == {"rate"}


def test_a_reference_that_is_slower_than_the_record_walks_as_far() -> None:
    """The same noise at a tenth of the samples, held in between: its integral is √10 times as far off."""
    noise = NOISE * np.random.default_rng(2).standard_normal(N)
    assert _random_walk(noise, N / RATE) == pytest.approx(NOISE / RATE * np.sqrt(N), rel=0.05)
    held = np.repeat(noise[: N // 10], 10)
    assert _random_walk(held, N / RATE) == pytest.approx(NOISE / RATE * np.sqrt(10.0 * N), rel=0.2)
    assert _random_walk(np.full(N, 0.1), N / RATE) == 0.0
