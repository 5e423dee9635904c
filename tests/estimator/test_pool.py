"""Several records in one trace: SciPy's solutions with known constants, held out by record."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.diagnosis import Diagnosis, Verdict
from estimator.errors import ModelError
from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.trace.pool.members import Level, Member, Pool, held_out_by_default
from estimator.trace.pool.trace import trace_pool

RATE, K, D, K3, NOISE = 400.0, (2 * np.pi * 20.0) ** 2, 3.0, 6.0e8, 2e-6
PER_KG = -1800.0


def decay(
    rng: np.random.Generator, start: float, stiffness: float = K, cubic: float = K3, samples: int = 320
) -> Record:
    t = np.arange(samples) / RATE
    solved = solve_ivp(
        lambda _, s: [s[1], -stiffness * s[0] - D * s[1] - cubic * s[0] ** 3],
        (0.0, t[-1]), (start, 0.0), "DOP853", t, rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    seen = solved.y[0] + rng.normal(0.0, NOISE, samples)
    return Record(seen[:, None], np.zeros((samples, 1, 1)), np.full(samples, 1 / RATE))


def pool(members: list[Member], covariate: str | None) -> Pool:
    device = Device(
        sample_rate=RATE,
        stiffness=(1.004 * K,),
        damping=(1.2 * D,),
        amplitude=1e-3,
        sense_gain=(1.0,),
        noise=(NOISE,),
    )
    settings = ObserverSettings(gain=Gain.EKF, spread=Spread(offset=NOISE, drive_gain=0.0))
    return Pool(tuple(members), device, settings, covariate)


@pytest.fixture(scope="module")
def loaded() -> Diagnosis:
    """Six decays under loads of 0 to 0.5 kg, two held out."""
    rng = np.random.default_rng(2)
    members = [
        Member(f"load {i}", decay(rng, start, K + PER_KG * 0.1 * i), 0.1 * i)
        for i, start in enumerate((2e-3, 1e-3, 1.5e-3, 8e-4, 1.8e-3, 1.2e-3))
    ]
    return trace_pool(pool(members, "load_kg"), (2, 3))


@pytest.mark.slow
def test_a_covariate_and_a_cubic_spring_are_told_apart(loaded: Diagnosis) -> None:
    assert loaded.verdict is Verdict.EXPLAINED
    assert [effect.name for effect in loaded.effects] == ["cubic_stiffness"]
    (found,) = loaded.dependences
    assert (found.name, found.covariate, found.reference) == ("kxx", "load_kg", pytest.approx(0.25))
    for interval, true in (
        (found.slope, PER_KG),
        (found.value, K + PER_KG * 0.25),
        (loaded.effects[0].coefficients["k3x"], K3),
    ):
        assert abs(interval.value - true) < interval.high - interval.low, "within two half intervals"
        assert interval.high - interval.low < 0.05 * abs(true)


@pytest.mark.moderate
def test_held_out_records_are_predicted_to_the_noise(loaded: Diagnosis) -> None:
    assert loaded.held_out_after.ratio == pytest.approx(1.0, abs=0.1)
    assert loaded.held_out_before.ratio > 10.0
    assert any("load 2, load_kg = 0.2" in reason for reason in loaded.reasons)


@pytest.mark.slow
def test_what_nothing_depends_on_is_not_found_to() -> None:
    """The same beam every time, and a covariate that means nothing."""
    rng = np.random.default_rng(5)
    members = [Member(f"run {i}", decay(rng, a, cubic=0.0), float(i)) for i, a in enumerate((2e-3, 1e-3, 1.5e-3, 8e-4))]
    found = trace_pool(pool(members, "serial_number"), (1,))
    assert found.verdict is Verdict.ADEQUATE
    assert found.dependences == ()
    assert found.effects == ()


@pytest.mark.slow
def test_records_that_differ_by_what_nobody_says_are_not_explained() -> None:
    rng = np.random.default_rng(6)
    members = [
        Member(f"run {i}", decay(rng, 1e-3, K * (1.0 + off), 0.0)) for i, off in enumerate((0.0, 0.02, -0.015, 0.01))
    ]
    found = trace_pool(pool(members, None), (3,))
    assert found.verdict is not Verdict.EXPLAINED
    assert found.verdict is not Verdict.ADEQUATE


@pytest.mark.moderate
def test_a_covariate_that_is_always_the_same_is_refused() -> None:
    rng = np.random.default_rng(7)
    members = [Member(f"run {i}", decay(rng, 1e-3), 0.3) for i in range(3)]
    with pytest.raises(ModelError, match=r"load_kg is 0\.3 on every record that is fitted"):
        Level.of(pool(members, "load_kg"))


@pytest.mark.moderate
def test_too_few_records_are_refused() -> None:
    rng = np.random.default_rng(8)
    members = [Member(f"run {i}", decay(rng, 1e-3)) for i in range(2)]
    with pytest.raises(ModelError, match="1 records to fit and 1 to judge"):
        trace_pool(pool(members, None), (1,))


@pytest.mark.parametrize(("number", "expected"), [(3, 1), (6, 2), (12, 4)])
def test_by_default_a_third_judges_from_within(number: int, expected: int) -> None:
    record = Record(np.zeros((1, 1)), np.zeros((1, 1, 1)), np.ones(1))
    values = np.random.default_rng(1).permutation(number)
    members = [Member(str(v), record, float(v)) for v in values]
    held = held_out_by_default(pool(members, "load_kg"))
    assert len(held) == expected == len(set(held))
    if number > 3:
        assert not {0.0, number - 1.0} & {members[i].covariate for i in held}
