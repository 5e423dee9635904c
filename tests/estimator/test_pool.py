"""Several records in one trace: SciPy's solutions with known constants, held out by record."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.stats import linregress, norm

from estimator.diagnosis import Diagnosis, Verdict
from estimator.errors import ModelError
from estimator.record import Record
from estimator.refinement import Declared
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.thresholds import THRESHOLDS
from estimator.trace.engine import Estimate
from estimator.trace.pool import trace as pool_trace
from estimator.trace.pool.fit import columns_of, error_on, fitted, simulated, slope_name
from estimator.trace.pool.members import Level, Member, Pool, Rows, held_out_by_default
from estimator.trace.pool.model import PooledModel, Promise, gain_of
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
    assert loaded.after.ratio == pytest.approx(1.0, abs=0.1)  # of those that were fitted
    assert loaded.before.ratio > 10.0
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


def test_without_a_covariate_nothing_is_scaled() -> None:
    record = Record(np.zeros((1, 1)), np.zeros((1, 1, 1)), np.ones(1))
    level = Level.of(pool([Member(str(i), record, 3.0) for i in range(3)], None))
    assert (level.mean, level.spread, level.scaled(3.0)) == (0.0, 1.0, 3.0)
    level = Level.of(pool([Member(str(i), record, i) for i in (1.0, 2.0, 6.0)], "load_kg"))
    assert level.scaled(3.0 + np.std([1.0, 2.0, 6.0])) == pytest.approx(1.0)


@pytest.mark.moderate
def test_too_few_records_are_refused() -> None:
    rng = np.random.default_rng(8)
    members = [Member(f"run {i}", decay(rng, 1e-3)) for i in range(2)]
    with pytest.raises(ModelError, match="1 records to fit and 1 to judge"):
        trace_pool(pool(members, None), (1,))


@pytest.mark.parametrize(("number", "expected"), [(1, 1), (2, 1), (3, 1), (6, 2), (12, 4)])
def test_by_default_a_third_judges_from_within(number: int, expected: int) -> None:
    record = Record(np.zeros((1, 1)), np.zeros((1, 1, 1)), np.ones(1))
    values = np.random.default_rng(1).permutation(number)
    members = [Member(str(v), record, float(v)) for v in values]
    held = held_out_by_default(pool(members, "load_kg"))
    assert len(held) == expected == len(set(held))
    if number > 3:
        assert not {0.0, number - 1.0} & {members[i].covariate for i in held}


@pytest.mark.parametrize("records", [3, 4, 6])
def test_a_constant_goes_with_the_covariate_where_neither_scatter_nor_doubt_makes_that_slope(records: int) -> None:
    """Beside SciPy's regression, and the normal distribution of what each record leaves open."""
    rng = np.random.default_rng(7)
    z = np.linspace(-1.0, 1.0, records)
    seen = set()
    for slope in np.geomspace(1e-3, 1e3, 60):
        values = 5.0 + slope * z + 1e-2 * rng.standard_normal(records)
        deviation = np.full(records, 3e-2)
        alone = [
            SimpleNamespace(names=["d", "k"], deviation=np.array([9.0, sd]), value=lambda name, v=v: float(v))
            for v, sd in zip(values, deviation, strict=True)
        ]
        fitted = linregress(z, values)
        doubt = np.sqrt(np.sum((deviation * z / np.sum(z**2)) ** 2))
        chance = max(fitted.pvalue, 2.0 * norm.sf(abs(fitted.slope) / doubt))
        found = pool_trace._line(z, alone, "k")
        assert (found is not None) == (chance < THRESHOLDS.criterion.chance)
        if found is not None:
            assert found == pytest.approx((np.mean(values), fitted.slope))
        seen.add(found is None)
    assert seen == {True, False}
    alone[0].deviation[1] = 0.0
    assert pool_trace._line(z, alone, "k") is None  # of which no record says anything


def test_a_pool_is_held_to_what_is_declared_of_its_constants_but_for_those_that_go_with_the_covariate() -> None:
    """A spring beyond its declaration is a conflict; one whose slope was found is declared for one load only."""
    known = {
        "kxx": Declared(100.0, 2.0),
        "dxx": Declared(1.0, 0.1),
        "k3x": Declared(0.0, 1.0),  # of an effect, not of the base model
    }
    estimates = {"kxx": Estimate(110.0, 109.0, 111.0), "dxx": Estimate(-1.0, -1.1, -0.9)}
    run = SimpleNamespace(
        observer=SimpleNamespace(model=SimpleNamespace(names=("x", "vx", "kxx", "dxx"))),
        known=known, slopes={}, estimate=estimates.__getitem__,
    )  # fmt: skip
    found = {one.name: one for one in pool_trace._constants(run)}
    assert set(found) == {"kxx", "dxx"}
    spring, damping = found["kxx"], found["dxx"]
    assert (spring.value, spring.low, spring.high) == (110.0, 109.0, 111.0)
    assert (spring.declared, spring.deviation, spring.positive) == (100.0, 2.0, True)
    assert damping.positive
    run.slopes = {"kxx": 3.0}
    assert [one.name for one in pool_trace._constants(run)] == ["dxx"]


# -- the fit of several records, beside SciPy's ---------------------------------------------------------------------


def oscillation(t: np.ndarray, start: float, speed: float, stiffness: float, damping: float) -> np.ndarray:
    """ẍ + d ẋ + k x = 0 in closed form."""
    frequency = np.sqrt(stiffness - 0.25 * damping**2)
    sine = (speed + 0.5 * damping * start) / frequency
    return np.exp(-0.5 * damping * t) * (start * np.cos(frequency * t) + sine * np.sin(frequency * t))


LOADS = (0.0, 0.2, 0.5)
STARTS = ((2e-3, 0.0), (-1e-3, 0.05), (1.5e-3, -0.1))
OFFSETS = (3e-6, -2e-6, 1e-6)


def linear_decays(rng: np.random.Generator, samples: int = 160) -> list[Member]:
    t = np.arange(samples) / RATE
    return [
        Member(
            f"load {load}",
            Record(
                (offset + oscillation(t, *start, K + PER_KG * load, D) + rng.normal(0.0, NOISE, samples))[:, None],
                np.zeros((samples, 1, 1)),
                np.full(samples, 1 / RATE),
            ),
            load,
        )
        for load, start, offset in zip(LOADS, STARTS, OFFSETS, strict=True)
    ]


def beside(declared_noise: float, damping_sd: float) -> SimpleNamespace:
    """A pool with a slope of the stiffness, and the same least squares by SciPy on the closed form: with the noise as
    it is, whatever is declared of it, and a damping that is declared to `damping_sd` [1/s], three of them off.
    """
    members = linear_decays(np.random.default_rng(11))
    several = pool(members, "load_kg")
    device = replace(several.device, noise=(declared_noise,), damping=(D + 3.0 * damping_sd,))
    sure = replace(several.settings.spread, damping=damping_sd / (D + 3.0 * damping_sd))
    several = replace(several, device=device, settings=replace(several.settings, spread=sure))
    level = Level.of(several)
    begun = pool_trace._started(several, level, (), lambda *what: None)
    masks = [np.ones(len(m.record), dtype=bool) for m in members]
    masks[1][100:] = False  # of one record, not all counts
    found = fitted(several, (), ("kxx",), begun, Rows(tuple(masks)), in_earnest=True)
    z = (np.array(LOADS) - np.mean(LOADS)) / np.std(LOADS)
    spring, damping = found.known["kxx"], found.known["dxx"]

    def residuals(theta: np.ndarray) -> np.ndarray:
        own, (k, d, slope) = theta[:9].reshape(3, 3), theta[9:] * (K, D, K)
        parts = []
        for (start, speed, offset), member, mask, tilt in zip(own, members, masks, z, strict=True):
            t = np.arange(len(member.record)) / RATE
            made = 1e-5 * offset + oscillation(t, 1e-3 * start, 1e-1 * speed, k + slope * tilt, d)
            parts.append(((made - member.record.sense[:, 0]) / NOISE)[mask])
        priors = [(value - one.value) / one.deviation for value, one in ((k, spring), (d, damping))]
        return np.concatenate([*parts, priors])

    begin = [1e3 * start if i == 0 else 10.0 * start for pair in STARTS for i, start in [*enumerate(pair), (2, 0.0)]]
    solved = least_squares(residuals, [*begin, 1.0, 1.0, 0.0], xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
    return SimpleNamespace(found=found, theta=solved.x, jacobian=solved.jac, members=members, level=level)


@pytest.fixture(scope="module")
def beside_scipy() -> SimpleNamespace:
    return beside(NOISE, 0.1 * D)


@pytest.mark.parametrize("declared_noise", [NOISE, NOISE / 5.0])
def test_what_is_declared_counts_for_as_much_as_it_is_sure_however_loud_the_records_are(declared_noise: float) -> None:
    """Of a noise that is declared too small, what the records say is worth less, and what is declared is not."""
    twin = beside(declared_noise, 2e-3)  # about as sure as three records tell it
    sd = np.sqrt(np.diagonal(np.linalg.inv(twin.jacobian.T @ twin.jacobian)))[10] * D
    assert sd < 1.5e-3
    assert twin.found.shared["dxx"] == pytest.approx(twin.theta[10] * D, abs=0.15 * sd)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_gain_is_twice_the_logarithm_of_how_much_the_residual_falls(seed: int) -> None:
    """n ln(σ²/σ′²) of white residuals, of samples that are worth as many."""
    rng = np.random.default_rng(seed)
    less, more = rng.normal(0.0, 2.0, 4000), rng.normal(0.0, 1.0, 4000)
    runs: list[Any] = [SimpleNamespace(spread_out=lambda rows, each=each: each) for each in (less, more)]
    rows: Any = None
    assert gain_of(*runs, rows) == pytest.approx(4000 * np.log(4.0), rel=0.1)


def test_who_promises_no_more_than_it_costs_is_not_tried() -> None:
    nothing = np.zeros((0, 1))
    look = {
        name: Promise(gain, 8.0, nothing)
        for name, gain in (("less", 7.9), ("as much", 8.0), ("more", 8.1), ("most", 9.0))
    }
    made: Any = None
    assert list(PooledModel.hopeful(made, look, {}, (), 0)) == ["most", "more"]


@pytest.mark.moderate
def test_what_the_bench_file_declares_is_carried_and_not_named() -> None:
    rng = np.random.default_rng(2)
    members = [Member(f"run {i}", decay(rng, start)) for i, start in enumerate((2e-3, 1e-3, 1.5e-3, 8e-4))]
    several = pool(members, None)
    declares = replace(several.settings, effects={"cubic_stiffness": {"k3x": 0.9 * K3}})
    found = trace_pool(replace(several, settings=declares), (1,))
    assert found.verdict is Verdict.ADEQUATE
    assert found.effects == ()


def test_a_pool_is_the_least_squares_of_all_its_records(beside_scipy: SimpleNamespace) -> None:
    found, theta = beside_scipy.found, beside_scipy.theta
    sd = np.sqrt(np.diagonal(np.linalg.inv(beside_scipy.jacobian.T @ beside_scipy.jacobian)))
    sizes = np.array([*(3 * [1e-3, 1e-1, 1e-5]), K, D, K])
    own = found.own_of(("x", "vx", "phi_x"), {})
    np.testing.assert_allclose(own.ravel(), (theta * sizes)[:9], atol=1e-2 * np.max((sd * sizes)[:9:3]))
    for value, number in ((found.shared["kxx"], 9), (found.shared["dxx"], 10), (found.slopes["kxx"], 11)):
        assert value == pytest.approx(theta[number] * sizes[number], abs=0.02 * sd[number] * sizes[number])
    # What is estimated of the noise's colour makes the deviations differ a little from those of white noise.
    for name, number in (("kxx", 9), ("dxx", 10), (slope_name("kxx"), 11)):
        assert found.deviation[name] == pytest.approx(sd[number] * sizes[number], rel=0.35)


def test_an_interval_is_95_percent_and_a_slope_is_by_one_of_the_covariate(beside_scipy: SimpleNamespace) -> None:
    found, spread = beside_scipy.found, float(np.std(LOADS))
    one, slope = found.estimate("dxx"), found.slope("kxx")
    assert (one.value, one.high - one.value) == pytest.approx(
        (found.shared["dxx"], 1.96 * found.deviation["dxx"]), rel=1e-3
    )
    assert one.value - one.low == pytest.approx(one.high - one.value)
    assert slope.value == pytest.approx(found.slopes["kxx"] / spread)
    assert slope.high - slope.low == pytest.approx(2 * 1.96 * found.deviation[slope_name("kxx")] / spread, rel=1e-3)
    assert abs(slope.value - PER_KG) < slope.high - slope.low


def test_what_is_left_of_each_record_is_the_noise_and_its_sign_is_seen_less_made(beside_scipy: SimpleNamespace) -> None:
    found = beside_scipy.found
    for number, member in enumerate(beside_scipy.members):
        left = found.residual[number]
        assert np.std(left) == pytest.approx(NOISE, rel=0.15)
        state = found.state(number, beside_scipy.level.scaled(member.covariate))
        made = simulated(found, member.record, state)[0]
        np.testing.assert_allclose(left, member.record.sense - made, atol=1e-12)


def test_a_record_held_out_is_judged_behind_its_first_quarter(beside_scipy: SimpleNamespace) -> None:
    """With its own motion and offset from there, and the stiffness of its load."""
    t = np.arange(400) / RATE
    rng = np.random.default_rng(12)
    seen = 1e-6 + oscillation(t, 1.2e-3, 0.0, K + PER_KG * 0.35, D) + rng.normal(0.0, NOISE, 400)
    record = Record(seen[:, None], np.zeros((400, 1, 1)), np.full(400, 1 / RATE))
    judges = pool([Member("judge", record, 0.35), Member("elsewhere", record, 0.0)], "load_kg")
    right, wrong = error_on(beside_scipy.found, judges)
    assert np.isnan(right[:100]).all()
    assert np.isfinite(right[100:]).all()
    assert np.nanstd(right) == pytest.approx(NOISE, rel=0.15)
    assert np.nanstd(wrong) > 10.0 * NOISE


@pytest.mark.parametrize("record", [0, 1, 2])
def test_a_record_moves_its_own_what_is_shared_and_the_slopes(record: int) -> None:
    """[own of all records | shared | slopes], a slope by z times its constant."""
    rng = np.random.default_rng(record)
    sensitivity = rng.standard_normal((5, 4))  # two of its own, two shared
    made = columns_of(2, record, 3, 0.7, sensitivity, [3])
    assert made.shape == (5, 3 * 2 + 2 + 1)
    expected = np.zeros((5, 9))
    expected[:, 2 * record : 2 * record + 2] = sensitivity[:, :2]
    expected[:, 6:8] = sensitivity[:, 2:]
    expected[:, 8] = 0.7 * sensitivity[:, 3]
    np.testing.assert_array_equal(made, expected)
