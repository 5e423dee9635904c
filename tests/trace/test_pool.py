"""Several records in one trace: SciPy's solutions with known constants, held out by record."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.stats import chi2

from estimator.diagnosis import Diagnosis, Verdict
from estimator.errors import ModelError
from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.trace.checks import agreement
from estimator.trace.filtered import Filtered
from estimator.trace.fit import FittedModel
from estimator.trace.free_run import FreeRun
from estimator.trace.likelihood import BLOCKS, Evaluation, Model
from estimator.trace.pool import Level, Member, Pool, held_out_by_default
from estimator.trace.pool_trace import trace_pool
from estimator.trace.pooled import Pooled, PooledFreeRun, pooled
from estimator.trace.pooled_layout import PooledLayout, constant_of, dependence
from tests.trace.linear import Parameters
from tests.trace.plain import Array

RATE, K, D, K3, NOISE = 400.0, (2 * np.pi * 20.0) ** 2, 3.0, 6.0e8, 2e-6
PER_KG = -1800.0


def decay(
    rng: np.random.Generator, start: float, stiffness: float = K, cubic: float = K3, offset: float = 0.0
) -> Record:
    t = np.arange(320) / RATE
    solved = solve_ivp(
        lambda _, s: [s[1], -stiffness * s[0] - D * s[1] - cubic * s[0] ** 3],
        (0.0, t[-1]), (start, 0.0), "DOP853", t, rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    seen = solved.y[0] + offset + rng.normal(0.0, NOISE, len(t))
    return Record(seen[:, None], np.zeros((len(t), 1, 1)), np.full(len(t), 1 / RATE))


def pool(members: list[Member], covariate: str | None, offset: float = NOISE) -> Pool:
    device = Device(
        sample_rate=RATE, stiffness=(1.004 * K,), damping=(1.2 * D,), amplitude=1e-3, sense_gain=(1.0,), noise=(NOISE,)
    )  # fmt: skip
    settings = ObserverSettings(gain=Gain.EKF, spread=Spread(offset=offset, drive_gain=0.0))
    return Pool(tuple(members), device, settings, covariate)


@pytest.fixture(scope="module")
def loaded() -> Diagnosis:
    """Six decays under loads of 0 to 0.5 kg, two held out."""
    rng = np.random.default_rng(2)
    members = [
        Member(f"load {i}", decay(rng, start, K + PER_KG * 0.1 * i), 0.1 * i)
        for i, start in enumerate((2e-3, 1e-3, 1.5e-3, 8e-4, 1.8e-3, 1.2e-3))
    ]
    return trace_pool(pool(members, "load_kg"), (3, 2))


@pytest.mark.moderate
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
    assert (found.value.unit, found.slope.unit, loaded.effects[0].coefficients["k3x"].unit) == (
        "1/s²", "1/s²", "1/(m²·s²)"
    )  # fmt: skip
    assert min(found.evidence, loaded.effects[0].evidence) > 1000.0


@pytest.mark.moderate
def test_held_out_records_are_predicted_to_the_noise(loaded: Diagnosis) -> None:
    assert loaded.held_out_after.ratio == pytest.approx(1.0, abs=0.1)
    assert loaded.held_out_before.ratio > 10.0
    assert loaded.after.ratio == pytest.approx(1.0, abs=0.1)  # of those that were fitted
    assert loaded.before.ratio > 10.0
    assert any("load 2, load_kg = 0.2, which was held out" in reason for reason in loaded.reasons)


@pytest.mark.moderate
def test_every_candidate_is_named_or_rejected_once(loaded: Diagnosis) -> None:
    rejected = [one.name for one in loaded.rejected]
    assert len(rejected) == len(set(rejected))
    assert not {"cubic_stiffness", "kxx by load_kg"} & set(rejected)
    assert {"sense_cubic", "drag", "dxx by load_kg", "k3x by load_kg"} <= set(rejected)
    # On one axis a spring that hardens along the radius is one that hardens along the axis: no candidate of its own.
    assert "cubic_isotropic" not in rejected
    cubic = next(one for one in loaded.probabilities if one.effect == "cubic_stiffness").probabilities
    assert cubic["cubic_stiffness"] > 0.99
    load = next(one for one in loaded.probabilities if one.effect == "kxx by load_kg").probabilities
    assert load["kxx by load_kg"] > 0.99
    for one in loaded.probabilities:
        assert sum(one.probabilities.values()) == pytest.approx(1.0)


@pytest.mark.moderate
def test_the_residual_is_told_of_all_samples_and_of_those_held_out(loaded: Diagnosis) -> None:
    assert loaded.split == 4 * 320
    was, now = loaded.residual_before, loaded.residual_after
    assert was.shape == now.shape == (6 * 320, 1)
    for fit, part in (
        (loaded.before, was[: 4 * 320]), (loaded.after, now[: 4 * 320]),
        (loaded.held_out_before, was[4 * 320 :]), (loaded.held_out_after, now[4 * 320 :]),
    ):  # fmt: skip
        assert fit.innovation_rms == (pytest.approx(np.sqrt(np.nanmean(part**2))),)
        assert fit.noise_floor == (NOISE,)
        assert fit.ratio == pytest.approx(fit.innovation_rms[0] / NOISE)
    # The first quarter of a record that judges tells where its free run begins.
    assert np.flatnonzero(np.isnan(now[:, 0])).tolist() == [
        4 * 320 + 320 * record + row for record in range(2) for row in range(80)
    ]
    assert loaded.share == pytest.approx(1.0, abs=1e-4)


@pytest.mark.moderate
def test_what_nothing_depends_on_is_not_found_to() -> None:
    """The same beam every time, and a covariate that means nothing."""
    rng = np.random.default_rng(5)
    members = [Member(f"run {i}", decay(rng, a, cubic=0.0), float(i)) for i, a in enumerate((2e-3, 1e-3, 1.5e-3, 8e-4))]
    found = trace_pool(pool(members, "serial_number"), (1,))
    assert found.verdict is Verdict.ADEQUATE
    assert found.dependences == ()
    assert found.effects == ()


@pytest.mark.moderate
def test_records_that_differ_unexplained_are_told_by_name() -> None:
    rng = np.random.default_rng(6)
    members = [
        Member(f"run {i}", decay(rng, 1e-3, K * (1.0 + off), 0.0)) for i, off in enumerate((0.0, 0.02, -0.015, 0.01))
    ]
    found = trace_pool(pool(members, None), (3,))
    assert found.verdict is Verdict.UNEXPLAINED
    assert any("run 1 does not agree with what the records share" in reason for reason in found.reasons)


@pytest.mark.moderate
def test_an_offset_is_each_records_own() -> None:
    rng = np.random.default_rng(9)
    offsets = (2e-5, -3e-5, 1e-5, 4e-5)
    members = [
        Member(f"run {i}", decay(rng, a, cubic=0.0, offset=b))
        for i, (a, b) in enumerate(zip((2e-3, 1e-3, 1.5e-3, 8e-4), offsets, strict=True))
    ]
    found = trace_pool(pool(members, None, 3e-5), (1,))
    assert found.verdict is Verdict.ADEQUATE, found.reasons


NO_SAMPLES = Record(np.zeros((1, 1)), np.zeros((1, 1, 1)), np.ones(1))


@pytest.mark.parametrize(
    ("loads", "same"),
    [((0.3, 0.1 + 0.2), True), ((0.0, 0.0), True), ((1.0, 1.0 + 5e-10), True), ((1.0, 1.0 + 1.5e-9), False)],
)
def test_loads_that_differ_by_rounding_are_one(loads: tuple[float, float], *, same: bool) -> None:
    several = pool([Member(str(load), NO_SAMPLES, load) for load in loads], "load_kg")
    if same:
        with pytest.raises(ModelError, match="on every record that is fitted"):
            Level.of(several)
    else:
        assert Level.of(several).spread == pytest.approx(0.75e-9)


def test_without_a_covariate_nothing_is_scaled() -> None:
    level = Level.of(pool([Member(str(i), NO_SAMPLES, 3.0) for i in range(3)], None))
    assert (level.mean, level.spread, level.scaled(3.0)) == (0.0, 1.0, 3.0)
    level = Level.of(pool([Member(str(i), NO_SAMPLES, i) for i in (1.0, 2.0, 6.0)], "load_kg"))
    assert level.scaled(3.0 + np.std([1.0, 2.0, 6.0])) == pytest.approx(1.0)


@pytest.mark.parametrize(("count", "held", "fit"), [(2, (1,), 1), (3, (), 3), (4, (0, 1, 2), 1)])
def test_too_few_records_are_refused(count: int, held: tuple[int, ...], fit: int) -> None:
    members = [Member(f"run {i}", NO_SAMPLES) for i in range(count)]
    with pytest.raises(ModelError, match=f"{fit} records to fit and {len(held)} to judge"):
        trace_pool(pool(members, None), held)


@pytest.mark.parametrize(("number", "expected"), [(1, 1), (2, 1), (3, 1), (6, 2), (12, 4)])
def test_by_default_a_third_judges_from_within(number: int, expected: int) -> None:
    values = np.random.default_rng(1).permutation(number)
    members = [Member(str(v), NO_SAMPLES, float(v)) for v in values]
    held = held_out_by_default(pool(members, "load_kg"))
    assert len(held) == expected == len(set(held))
    if number > 3:
        assert not {0.0, number - 1.0} & {members[i].covariate for i in held}


def test_of_six_the_third_and_the_fifth_judge() -> None:
    members = [Member(str(load), NO_SAMPLES, load) for load in (5.0, 2.0, 9.0, 1.0, 7.0, 3.0)]
    assert [members[place].covariate for place in held_out_by_default(pool(members, "load_kg"))] == [7.0, 3.0]


def test_a_dependence_is_called_by_its_constant_and_covariate() -> None:
    assert constant_of(dependence("kxx", "load_kg")) == "kxx"
    assert constant_of("cubic_stiffness") is None


GYRO = Device(
    sample_rate=4000.0, stiffness=((2 * np.pi * 200.0) ** 2, (2 * np.pi * 202.0) ** 2, 0.0), damping=(4.0, 4.0, 0.0),
    amplitude=1e-4, sense_gain=(1e3, 1e3), noise=(1e-4, 1e-4),
)  # fmt: skip
GAIN = 0.02


def driven(seed: int, stiffer: float = 1.0, samples: int = 3000, gain: float = GAIN) -> Record:
    """Of a gyro that is driven by held noise, one gain off on x: a linear system, step by step by its exponential."""
    rng = np.random.default_rng(seed)
    kxx, kyy, _ = GYRO.stiffness
    flow = np.zeros((6, 6))
    flow[0, 1] = flow[2, 3] = 1.0
    flow[1, [0, 1, 4]] = -stiffer * kxx, -4.0, 1.0 + gain
    flow[3, [2, 3, 5]] = -stiffer * kyy, -4.0, 1.0
    step = expm(flow / GYRO.sample_rate)
    drive = 0.05 * kxx * 1e-4 * rng.standard_normal((samples, 2))
    state = np.array([1e-4, 0.0, 0.0, 1e-4 * np.sqrt(kyy), 0.0, 0.0])
    seen = np.zeros((samples, 2))
    for row in range(samples):
        state[4:] = drive[row]
        state = step @ state
        seen[row] = state[[0, 2]]
    sense = 1e3 * seen + 1e-4 * rng.standard_normal((samples, 2))
    return Record(sense, drive[:, :, None], np.full(samples, 1.0 / GYRO.sample_rate))


def gyros(records: list[Record], covariate: str | None = None) -> Pool:
    members = tuple(Member(f"run {i}", record, float(i)) for i, record in enumerate(records))
    settings = ObserverSettings(memory=0.5, spread=Spread(rate=0.1, stiffness=0.02, damping=1.0))
    return Pool(members, GYRO, settings, covariate)


@pytest.mark.moderate
def test_two_axes_are_one_likelihood_too() -> None:
    found = trace_pool(gyros([driven(seed) for seed in range(4)]), (2,))
    assert found.verdict is Verdict.EXPLAINED, found.reasons
    assert [effect.name for effect in found.effects] == ["drive_gain"]
    hx, hy = (found.effects[0].coefficients[name] for name in ("hx", "hy"))
    for interval, true in ((hx, GAIN), (hy, 0.0)):
        assert abs(interval.value - true) < interval.high - interval.low
    assert found.angle_moved is not None
    assert found.effects[0].angle_bound is not None


@pytest.mark.moderate
@pytest.mark.parametrize("other", [1, 3])
def test_a_record_of_another_device_is_told(other: int) -> None:
    records = [driven(seed, 1.003 if seed == other else 1.0, gain=0.0) for seed in range(4)]
    found = trace_pool(gyros(records), (3,))
    assert found.verdict is Verdict.UNEXPLAINED
    assert any(f"run {other} does not agree with what the records share" in one for one in found.reasons)


def ringing(seed: int, cubic: float) -> Record:
    """The same gyro, let go from rest, with a spring that hardens on both axes."""
    rng = np.random.default_rng(seed)
    (kxx, kyy, _), t = GYRO.stiffness, np.arange(2000) / GYRO.sample_rate
    start = 1e-4 * rng.uniform(0.6, 1.4, 2)
    solved = solve_ivp(
        lambda _, s: [
            s[1], -kxx * s[0] - 4.0 * s[1] - cubic * s[0] ** 3, s[3], -kyy * s[2] - 4.0 * s[3] - cubic * s[2] ** 3
        ],
        (0.0, t[-1]), (start[0], 0.0, start[1], 0.0), "DOP853", t, rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    seen = 1e3 * solved.y[[0, 2]].T + 1e-4 * rng.standard_normal((len(t), 2))
    return Record(seen, np.zeros((len(t), 2, 1)), np.full(len(t), 1.0 / GYRO.sample_rate))


@pytest.mark.moderate
def test_decays_of_two_axes_tell_a_spring_that_hardens() -> None:
    cubic = 0.01 * GYRO.stiffness[0] / 1e-4**2
    found = trace_pool(gyros([ringing(seed, cubic) for seed in range(4)]), (3,))
    assert found.verdict is Verdict.EXPLAINED, found.reasons
    (effect,) = found.effects
    assert effect.name == "cubic_stiffness"
    for interval in effect.coefficients.values():
        assert abs(interval.value - cubic) < interval.high - interval.low < 0.02 * cubic


@pytest.mark.moderate
def test_a_filter_follows_a_driven_and_an_undriven_record() -> None:
    found = trace_pool(gyros([ringing(0, 0.0), driven(1), driven(2), driven(3)]), (3,))
    assert found.verdict is Verdict.EXPLAINED, found.reasons
    assert [effect.name for effect in found.effects] == ["drive_gain"]


def of_gyros(covariate: str | None = None, effects: tuple[str, ...] = ()) -> tuple[Pooled, PooledLayout, Model]:
    several = gyros([driven(seed, samples=1500) for seed in range(3)], covariate)
    fit, judges = several.divided((2,))
    whole = pooled(fit, judges, Filtered)
    of = whole.part(slice(0, whole.fitted_samples))
    layout = of.layout({name: {} for name in effects})
    rng = np.random.default_rng(3)
    theta = layout.mean + 1e-4 * rng.standard_normal(len(layout.names))
    return of, layout, Model({name: {} for name in effects}, theta, of.declared_noise())


def test_the_likelihood_is_the_sum_of_the_records() -> None:
    of, layout, model = of_gyros(effects=("drive_gain",))
    seen = of.evaluate(layout, model)
    each = []
    for part in of.parts:
        alone, chart = layout.of_record(part)
        each.append(part.of.evaluate(alone, replace(model, theta=chart @ model.theta)))
    assert seen.records == ("run 0", "run 1")
    assert seen.power.sum() == pytest.approx(sum(one.power.sum() for one in each))
    assert seen.count.sum() == sum(one.count.sum() for one in each)
    np.testing.assert_allclose(seen.score.sum(axis=0), sum(one.score.sum(axis=0) for one in each), rtol=1e-12)
    np.testing.assert_allclose(
        seen.information.sum(axis=0), sum(one.information.sum(axis=0) for one in each), rtol=1e-12
    )
    assert len(seen.innovation) == of.samples


def test_a_slope_moves_a_record_as_its_constant_does_times_the_covariate() -> None:
    name = dependence("kxx", "load_kg")
    of, layout, model = of_gyros("load_kg", (name,))
    (slope,) = layout.of(name)
    seen = of.evaluate(layout, model)
    constant = layout.constants[layout.names.index("kxx")]
    z = [part.z for part in of.parts]
    blocks = seen.score.reshape(2, BLOCKS, -1).sum(axis=1)
    np.testing.assert_allclose(blocks[:, slope], z * blocks[:, constant], rtol=1e-9)
    # Tested beside a model without it, the score is the same.
    plain = of.layout({})
    theta = np.delete(model.theta, slope)
    theta_at = np.array([model.theta[slope] * 0.0, *theta])[1:]
    beside = of.evaluate(plain, Model({}, theta_at, model.noise), tested={name: {}})
    at_zero = of.evaluate(layout, replace(model, theta=np.insert(theta, slope, 0.0)))
    np.testing.assert_allclose(beside.score[:, -1], at_zero.score[:, slope], rtol=1e-9)
    assert layout.factor[slope] == pytest.approx(layout.factor[constant] / of.level.spread)


def test_the_scores_are_the_slope_of_the_likelihood() -> None:
    """By each of the pool's parameters, own starts and a slope among them: differences of free runs."""
    rng = np.random.default_rng(4)
    members = [Member(f"run {i}", decay(rng, a, cubic=0.0), float(i)) for i, a in enumerate((2e-3, 1e-3, 1.5e-3))]
    fit, judges = pool(members, "load_kg").divided((2,))
    whole = pooled(fit, judges, FreeRun)
    assert isinstance(whole, PooledFreeRun)
    of = whole.part(slice(0, whole.fitted_samples))
    name = dependence("kxx", "load_kg")
    layout = of.layout({name: {}})
    assert sum(" of " in one for one in layout.names) == len(layout.start)
    assert len(layout.start) % 2 == 0
    model = Model({name: {}}, layout.mean.copy(), of.declared_noise())
    seen = of.evaluate(layout, model)
    for k in range(len(layout.names)):
        step = 1e-6
        powers = []
        for sign in (1.0, -1.0):
            theta = model.theta.copy()
            theta[k] += sign * step
            moved = of.evaluate(layout, replace(model, theta=theta), derivatives=False)
            powers.append(moved.power.sum())
        slope = -0.5 * (powers[0] - powers[1]) / (2.0 * step)
        size = np.sqrt(seen.information.sum(axis=0)[k, k] * seen.power.sum())
        assert seen.score.sum(axis=0)[k] == pytest.approx(slope, abs=1e-5 * size), layout.names[k]


def test_a_part_is_the_beginning_of_each_record() -> None:
    records = [driven(seed, samples=count) for seed, count in enumerate((300, 2000, 2000, 500))]
    fit, judges = gyros(records).divided((3,))
    whole = pooled(fit, judges, Filtered)
    assert (whole.samples, whole.fitted_samples) == (4800, 4300)
    assert [part.of.samples for part in whole.part(slice(0, 1300)).parts] == [300, 500, 500]
    assert [part.of.samples for part in whole.part(slice(0, 4300)).parts] == [300, 2000, 2000]
    assert [part.name for part in whole.part(slice(4300, None)).parts] == ["run 3"]
    assert whole.part(slice(4300, 4700)).samples == 400


def test_temperatures_count_from_one_reading() -> None:
    records = [replace(driven(i, samples=200), channels={"temperature": np.full(200, 20.0 + i)}) for i in range(3)]
    whole = pooled(*gyros(records).divided((2,)), Filtered)
    assert {part.of.beginning.temperature for part in (*whole.parts, *whole.judges)} == {20.0}


def test_a_constant_following_the_covariate_may_differ_from_the_declared() -> None:
    of, layout, _ = of_gyros("load_kg", (dependence("kxx", "load_kg"),))
    assert layout.varying == {"kxx"}
    assert of.layout({}).varying == frozenset()


def made(scores: Array, information: Array, names: tuple[str, ...]) -> tuple[FittedModel, Evaluation]:
    """A model at its top and a pass with these scores by record (records, k), each spread over its parts."""
    records, k = scores.shape
    layout = Parameters(k, {}, {})
    parts = np.repeat(scores / BLOCKS, BLOCKS, axis=0)
    count = np.full(records * BLOCKS, 100.0)
    each = np.tile(information / BLOCKS, (records * BLOCKS, 1, 1))
    nothing: Array = np.zeros((0, 1))
    seen = Evaluation(layout.names, parts, each, count, 0.0 * count, count, nothing, nothing, records=names)
    return FittedModel(layout, Model({}, layout.mean, None), seen, 0.0), seen  # type: ignore[arg-type]


@pytest.mark.parametrize("held_out", [False, True])
def test_agreement_is_a_chi_square_of_what_is_shared(held_out: bool) -> None:
    """Of records drawn with the same constants the power over what is expected is χ², by its mean and its quantile."""
    rng = np.random.default_rng(8)
    k, records = 3, 4
    root = np.linalg.cholesky(np.array([[400.0, 120.0, 0.0], [120.0, 900.0, 60.0], [0.0, 60.0, 100.0]]))
    names = tuple(f"run {i}" for i in range(records))
    ratios = []
    for _ in range(200):
        scores = rng.standard_normal((records, k)) @ root.T
        if held_out:
            moved = (
                rng.standard_normal(k) @ root.T * np.sqrt(records) / records
            )  # J C of what the fitted ones moved it by
            scores = scores - moved
        else:
            scores = scores - scores.mean(axis=0)
        model, seen = made(scores, root @ root.T, names)
        checks = agreement(model, seen, held_out=held_out)
        assert all(check.passed for check in checks)
        ratios += [float(check.sentence.split("by ")[1].split(" ×")[0]) for check in checks]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)
    assert np.quantile(ratios, 0.95) == pytest.approx(chi2.ppf(0.95, k) / k, rel=0.1)


def test_a_record_whose_constant_is_elsewhere_does_not_agree() -> None:
    information = np.diag([400.0, 900.0])
    for deviations, agrees in ((1.0, True), (12.0, False)):
        scores = np.zeros((3, 2))
        scores[:, 1] = deviations * 30.0 * np.array([2.0, -1.0, -1.0]) / np.sqrt(6.0)
        model, seen = made(scores, information, ("a", "b", "c"))
        first, *_ = agreement(model, seen, held_out=False)
        assert first.passed is agrees
        assert first.effect == ""
        if not agrees:
            assert "a does not agree with what the records share" in first.sentence
            assert "first of b1" in first.sentence
            assert float(first.sentence.rsplit("by ", 1)[1].split()[0]) == pytest.approx(scores[0, 1] / 900.0, rel=0.01)


def test_the_initial_state_is_as_sure_whatever_the_share_of_samples() -> None:
    rng = np.random.default_rng(4)
    members = [Member(f"run {i}", decay(rng, a, cubic=0.0)) for i, a in enumerate((2e-3, 1e-3, 1.5e-3))]
    whole = pooled(*pool(members, None).divided((2,)), FreeRun)
    layout = whole.part(slice(0, whole.fitted_samples)).layout({})
    assert isinstance(layout, PooledLayout)
    spread = layout.spread(0.25)
    np.testing.assert_array_equal(spread[layout.start], layout.deviation[layout.start])
    np.testing.assert_allclose(spread[layout.constants], 2.0 * layout.deviation[layout.constants])


def test_an_unfitted_record_begins_at_the_mean_of_the_fitted() -> None:
    rng = np.random.default_rng(4)
    members = [Member(f"run {i}", decay(rng, a, cubic=0.0)) for i, a in enumerate((2e-3, 1e-3, 1.5e-3))]
    whole = pooled(*pool(members, None).divided((2,)), FreeRun)
    layout = whole.part(slice(0, whole.fitted_samples)).layout({})
    assert isinstance(layout, PooledLayout)
    alone, chart = layout.of_record(whole.judges[0])
    own = [k for k in range(len(alone.names)) if k >= layout.common]
    np.testing.assert_allclose(chart[own].sum(axis=1), 1.0)
    np.testing.assert_array_equal(np.count_nonzero(chart[own], axis=1), 2)


def test_what_a_records_layout_bounds_is_bounded_in_the_pool() -> None:
    """A friction that turns over within less than it slows the mass by from one sample to the next."""
    rng = np.random.default_rng(4)
    members = [Member(f"run {i}", decay(rng, a, cubic=0.0)) for i, a in enumerate((2e-3, 1e-3, 1.5e-3))]
    whole = pooled(*pool(members, None).divided((2,)), FreeRun)
    of = whole.part(slice(0, whole.fitted_samples))
    found = of.candidates(Model({}, of.layout({}).mean, of.declared_noise()), of.evaluate(
        of.layout({}), Model({}, of.layout({}).mean, of.declared_noise())
    ))  # fmt: skip
    name = next(one for one in found if one.startswith("dry_friction"))
    layout = of.layout({name: found[name]})
    assert isinstance(layout, PooledLayout)
    alone, chart = layout.of_record(of.parts[0])
    theta = layout.mean.copy()
    theta[layout.of(name)[0]] = 1e3
    bounded = layout.bounded(theta)
    np.testing.assert_allclose((chart @ bounded)[: layout.common], alone.bounded(chart @ theta)[: layout.common])
    assert not np.array_equal(bounded, theta)
