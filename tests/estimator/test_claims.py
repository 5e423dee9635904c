"""What a claim of two axes is made of: constants, the rate where it strays, ranges, votes; each by its arithmetic."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from estimator.diagnosis import Fit
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Gain, ObserverSettings, ProcessNoise, Spread
from estimator.trace import claims
from estimator.trace.engine import Estimate
from estimator.trace.problem import Problem
from estimator.trace.promises import Constant
from tests.estimator.device import UNLIKE as DEVICE

N, SPLIT, RATE = 1000, 600, 4000.0
Z = norm.ppf(0.975)
SETTINGS = ObserverSettings(
    gain=Gain.STATIONARY, memory=0.02, spread=Spread(stiffness=0.01, damping=0.5, offset=0.003, rate=0.3),
    process_noise=ProcessNoise(rate=2.0), initial={"rate": 0.1}, effects={"drag": {"dqx": 1.0}},
)  # fmt: skip


def problem(**channels: Array) -> Problem:
    sense = np.linspace(-1.0, 2.0, N)[:, None] * np.array([1.0, -2.0])
    return Problem(Record(sense, np.zeros((N, 2, 1)), np.full(N, 1.0 / RATE), channels), DEVICE, SETTINGS)


# -- constants --------------------------------------------------------------------------------------------------------


@pytest.mark.moderate
def test_constants_are_as_found_beside_what_is_declared_without_the_rate_and_without_coefficients() -> None:
    observer = Observer(DEVICE, SETTINGS)
    declared = Observer(DEVICE, ObserverSettings(gain=Gain.EKF, spread=SETTINGS.spread, initial=SETTINGS.initial))
    deviation = dict(zip(declared.estimated, np.sqrt(np.diagonal(declared.covariance)).tolist(), strict=True))
    observer.arrays.p[:] = np.diag(np.linspace(1e-6, 4e-6, len(observer.arrays.p)))
    sure = dict(zip(observer.estimated, np.sqrt(np.diagonal(observer.covariance)).tolist(), strict=True))
    innovation = np.full((N, 2), 2.5)
    model: Any = SimpleNamespace(
        observer=observer,
        estimates=SimpleNamespace(innovation=innovation, innovation_deviation=np.ones((N, 2))),
    )
    found = {one.name: one for one in claims.constants_of(problem(), model)}
    assert set(found) == set(declared.estimated[4:]) - {"rate"}
    assert {"kxx", "kyy", "kxy", "dxx", "dyy", "dxy"} <= set(found)
    for name, one in found.items():
        value = float(observer.state[observer.names.index(name)])
        half = Z * 2.5 * sure[name]  # widened by what the innovations are larger than predicted
        assert (one.value, one.low, one.high) == pytest.approx((value, value - half, value + half), rel=1e-9)
        assert one.declared == float(declared.state[declared.names.index(name)])
        assert one.deviation == pytest.approx(deviation[name])
        assert one.positive is (name in ("kxx", "kyy", "dxx", "dyy"))


# -- the rate ---------------------------------------------------------------------------------------------------------


def strayed(rate: Array, sure: Array | float = 0.05, every: int = 1) -> tuple[Constant, ...]:
    index = np.arange(every - 1, N, every)
    deviation = np.zeros((len(index), 2))
    deviation[:, 1] = sure if isinstance(sure, float) else sure[index]
    estimates = SimpleNamespace(names=("x", "rate"), index=index, of=lambda name: rate[index], deviation=deviation)
    after: Any = SimpleNamespace(estimates=estimates)
    return claims._rate(problem(), after, SPLIT)


@pytest.mark.parametrize(("most", "every"), [(3.0, 1), (-3.0, 1), (3.0, 5)])
def test_the_rate_is_told_where_it_strays_farthest_on_the_part_held_out(most: float, every: int) -> None:
    """From the initial value 0.1, beside a spread of 0.3 and a random walk of 2 rad/s per root second over 0.25 s."""
    rate = np.full(N, 0.1)
    rate[SPLIT - 1], rate[799], rate[904] = 99.0, most, 0.5
    (one,) = strayed(rate, every=every)
    assert (one.name, one.value, one.declared) == ("rate", most, 0.1)
    assert (one.low, one.high) == pytest.approx((most - Z * 0.05, most + Z * 0.05))
    assert one.deviation == pytest.approx(math.sqrt(0.3**2 + 2.0**2 * N / RATE))


def test_what_is_far_and_unsure_strays_less_than_what_is_nearer_and_sure() -> None:
    rate, sure = np.full(N, 0.1), np.full(N, 0.05)
    rate[700], sure[700] = 4.0, 2.0  # 3.9 less 3.92
    rate[701], sure[701] = -1.0, 0.4  # 1.1 less 0.78
    rate[702] = np.nan
    (one,) = strayed(rate, sure)
    assert one.value == -1.0
    assert one.high - one.low == pytest.approx(2.0 * Z * 0.4)


def test_the_first_sample_held_out_counts_and_the_last_one_fitted_does_not() -> None:
    rate = np.full(N, 0.1)
    rate[SPLIT], rate[SPLIT - 1] = 2.0, 3.0
    assert strayed(rate)[0].value == 2.0


def test_of_a_rate_that_was_never_seen_nothing_is_told() -> None:
    assert strayed(np.full(N, np.nan)) == ()
    single: Any = SimpleNamespace(estimates=SimpleNamespace(names=("x", "vx")))
    assert claims._rate(problem(), single, SPLIT) == ()


# -- ranges -----------------------------------------------------------------------------------------------------------


def test_a_sense_that_is_clipped_whole_cannot_leave_its_range() -> None:
    """Gains of −890 and 445 V/m; of an axis whose share may be one, and of no other effect."""
    effects: Any = {
        "sense_clipping:2": {"sx": Estimate(0.9, 0.8, 1.1), "sy": Estimate(1.0, 0.999, 1.0001)},
        "sense_clipping:3": {"sx": Estimate(0.5, 0.4, 0.99), "sy": Estimate(1.2, 1.01, 1.4)},
        "drive_saturation:1": {"sx": Estimate(1.0, 0.9, 1.1)},
    }
    selection: Any = SimpleNamespace(effects={"sense_clipping:2": {"level": 2e-3}, "sense_clipping:3": {"level": 1.0}})
    asked = problem()
    asked.record.sense[700] = np.nan
    asked.record.sense[3] = 50.0
    found = claims._levels(asked, selection, effects, SPLIT)
    assert [(one.effect, one.low, one.high) for one in found] == [
        ("sense_clipping", pytest.approx(-1.78), pytest.approx(1.78)),
        ("sense_clipping", pytest.approx(-0.89), pytest.approx(0.89)),
    ]
    for axis, one in enumerate(found):
        later = asked.record.sense[SPLIT:, axis]
        assert (one.lowest, one.highest) == (np.nanmin(later), np.nanmax(later))
        assert one.noise == DEVICE.noise[axis]


@pytest.mark.parametrize(("low", "high", "told"), [(0.9, 1.0, True), (1.0, 1.1, True), (0.9, 0.999, False)])
def test_a_share_of_one_is_within_its_interval(low: float, high: float, *, told: bool) -> None:
    effects: Any = {"sense_clipping": {"sx": Estimate(0.95, low, high)}}
    selection: Any = SimpleNamespace(effects={"sense_clipping": {"level": 1.0}})
    assert bool(claims._levels(problem(), selection, effects, SPLIT)) is told


# -- votes ------------------------------------------------------------------------------------------------------------


def seen(rate_error: float | None, angle_error: float | None, sure: float = 0.01, every: int = 1) -> Any:
    index = np.arange(every - 1, N, every)
    deviation = np.full((len(index), 2), 77.0)
    deviation[:, 1] = np.where(index >= SPLIT, sure, 55.0)
    angle_deviation = np.where(np.arange(N) >= SPLIT, 0.002, 9.0)
    rates = np.where(index >= SPLIT, 0.0 if rate_error is None else rate_error, 44.0)
    estimates = SimpleNamespace(
        names=("x", "rate"), index=index, deviation=deviation, angle_deviation=angle_deviation, of={"rate": rates}.get
    )
    fit = Fit((1.0,), (1.0,), 1.0, 0.5, angle_error_rms=angle_error, rate_error_rms=rate_error)
    return SimpleNamespace(estimates=estimates, held_out=fit)


def reference(noise: float) -> Array:
    """A rate that alternates by its noise: its steps from sample to sample are twice that, and their deviation too."""
    signs = np.where(np.arange(N) % 2, 1.0, -1.0)
    signs[:SPLIT] *= 50.0
    return 3.0 + noise * signs


@pytest.mark.parametrize("noise", [0.0, 0.02, 20.0])
def test_rate_and_angle_vote_beside_what_is_to_be_expected_of_them(noise: float) -> None:
    """An alternating series says √2 of its size; a random walk over n steps of h is √n h of it."""
    asked = problem(rate=reference(noise))
    rate, angle = claims._votes(asked, seen(0.001, 0.3), seen(0.0005, 0.1), SPLIT)
    told = noise * math.sqrt(2.0)
    assert (rate.what, rate.unit, angle.what, angle.unit) == ("error of the rate", "rad/s", "error of the angle", "rad")
    assert (rate.errors.before, rate.errors.after) == (0.001, 0.0005)
    assert rate.errors.floor == pytest.approx(math.hypot(0.01, told), rel=1e-2)
    assert rate.errors.samples == pytest.approx((N - SPLIT) / RATE / 0.02)  # one draw a memory
    assert (angle.errors.before, angle.errors.after, angle.errors.samples) == (0.3, 0.1, 1.0)
    random_walk = told / RATE * math.sqrt(N - SPLIT)
    assert angle.errors.floor == pytest.approx(math.hypot(0.002, random_walk), rel=1e-2)


def test_what_is_to_be_expected_is_of_the_part_held_out_from_its_first_sample_on() -> None:
    after = seen(1e-3, 0.3, 0.0)
    after.estimates.deviation[SPLIT, 1], after.estimates.angle_deviation[SPLIT] = 3.0, 0.7
    rate, angle = claims._votes(problem(rate=reference(0.0)), seen(1e-3, 0.3), after, SPLIT)
    assert rate.errors.floor == pytest.approx(3.0 / math.sqrt(N - SPLIT))
    assert angle.errors.floor == pytest.approx(math.sqrt((0.7**2 + (N - SPLIT - 1) * 0.002**2) / (N - SPLIT)))


def test_a_rate_only_must_not_become_worse() -> None:
    """Its move is the one from 0.4 to 0.5 on the part held out, before which both are alike."""
    (rate, angle) = claims._votes(problem(rate=reference(0.0)), seen(0.4, 0.3), seen(0.5, 0.1), SPLIT)
    assert rate.errors.floor == pytest.approx(0.01)
    assert rate.moved == pytest.approx(0.1)
    assert angle.moved is None


def test_of_less_than_a_memory_an_error_is_one_draw() -> None:
    from dataclasses import replace

    asked = problem(rate=reference(0.0))
    slow = asked.under(replace(SETTINGS, memory=5.0))
    assert claims._votes(slow, seen(0.4, 0.3), seen(0.5, 0.1), SPLIT)[0].errors.samples == 1.0


@pytest.mark.parametrize(
    ("before", "after", "votes"),
    [
        ((0.1, 0.2), (0.1, 0.2), ["error of the rate", "error of the angle"]),
        ((0.1, None), (0.1, 0.2), ["error of the rate"]),
        ((0.1, 0.2), (0.1, None), ["error of the rate"]),
        ((None, 0.2), (0.1, 0.2), []),
        ((0.1, 0.2), (None, 0.2), []),
    ],
)
def test_who_has_no_error_has_no_vote(before: Any, after: Any, votes: list[str]) -> None:
    asked = problem(rate=reference(0.0))
    assert [vote.what for vote in claims._votes(asked, seen(*before), seen(*after), SPLIT)] == votes
    assert claims._votes(problem(), seen(*before), seen(*after), SPLIT) == ()


def test_states_that_were_kept_now_and_then_vote_as_all() -> None:
    asked = problem(rate=reference(0.0))
    one, other = (claims._votes(asked, seen(1e-3, 0.3, every=k), seen(1e-3, 0.1, every=k), SPLIT)[0] for k in (1, 5))
    assert one.errors.floor == pytest.approx(other.errors.floor)


# -- together ---------------------------------------------------------------------------------------------------------


def test_a_claim_is_of_all_that_may_speak_against_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Departures of the part that was fitted; all else of the record and where it is split."""
    asked: dict[str, Any] = {}

    def noting(name: str, answer: Any) -> Any:
        def note(*given: Any) -> Any:
            asked[name] = given
            return answer

        return note

    monkeypatch.setattr(claims, "constants_of", noting("constants", ("k",)))
    for name, answer in (("_rate", ("r",)), ("_levels", ("l",)), ("_votes", ("v",)), ("_departures", {"d": 1})):
        monkeypatch.setattr(claims, name, noting(name, answer))
    monkeypatch.setattr(claims, "contest", noting("contest", "contest"))
    monkeypatch.setattr(claims, "sidebands", noting("sidebands", ("s",)))
    monkeypatch.setattr(claims, "log_likelihood", lambda innovation, deviation: float(np.sum(innovation * deviation)))
    fit = claims.Fit((2.0, 2.0), (1.0, 1.0), 2.0, 0.5)
    before, after = (
        SimpleNamespace(
            held_out=fit, innovations=name,
            estimates=SimpleNamespace(innovation=np.full((N, 2), size), innovation_deviation=np.ones((N, 2))),
        )
        for name, size in (("was", 1.0), ("now", 3.0))
    )  # fmt: skip
    given = problem()
    selection: Any = SimpleNamespace(coefficients={"drag": {}, "sense_gain": {}}, after="model", effects="all")
    claim = claims.claim_of(given, selection, before, after, SPLIT)  # type: ignore[arg-type]
    assert set(claim.effects) == {"sense_gain"}  # the drag was known
    assert claim.residual.gain == 2.0 * 2 * (N - SPLIT)
    assert claim.residual.samples == 2 * (N - SPLIT)
    assert (claim.constants, claim.levels, claim.votes) == (("k", "r"), ("l",), ("v",))
    assert (claim.contest, claim.departures, claim.sidebands) == ("contest", {"d": 1}, ("s",))
    assert len(asked["sidebands"][0]) == SPLIT
    assert asked["sidebands"][1:] == ("all", claim.effects)
    assert asked["constants"] == (given, "model")
    assert asked["_rate"] == (given, after, SPLIT)
    assert asked["_levels"] == (given, selection, claim.effects, SPLIT)
    assert asked["_votes"] == (given, before, after, SPLIT)
    assert asked["contest"] == ("was", "now", SPLIT)
    assert len(asked["_departures"][0].record) == SPLIT
    assert asked["_departures"][1:] == (selection, claim.effects)
