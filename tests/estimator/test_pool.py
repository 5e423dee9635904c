"""Several records in one trace: SciPy's solutions with known constants, held out by record."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import lstsq
from scipy.optimize import least_squares
from scipy.signal import cont2discrete
from scipy.stats import linregress, norm

from estimator.correlation import effective_samples
from estimator.diagnosis import Diagnosis, Verdict
from estimator.errors import ModelError
from estimator.record import Record
from estimator.refinement import Declared
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.side_by_side import Abandoned
from estimator.thresholds import THRESHOLDS
from estimator.trace.determined import unsettled
from estimator.trace.engine import Estimate, Round, Score, Trial
from estimator.trace.pool import fit as pool_fit
from estimator.trace.pool import model as pool_model
from estimator.trace.pool import trace as pool_trace
from estimator.trace.pool.fit import (
    PooledRun,
    columns_of,
    error_on,
    fitted,
    observer_of,
    own_names,
    shared_names,
    simulated,
    slope_name,
)
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
def traced() -> tuple[Diagnosis, list[tuple[str, int, int]]]:
    """Six decays under loads of 0 to 0.5 kg, two held out; and what was told on the way."""
    rng = np.random.default_rng(2)
    members = [
        Member(f"load {i}", decay(rng, start, K + PER_KG * 0.1 * i), 0.1 * i)
        for i, start in enumerate((2e-3, 1e-3, 1.5e-3, 8e-4, 1.8e-3, 1.2e-3))
    ]
    told: list[tuple[str, int, int]] = []
    return trace_pool(pool(members, "load_kg"), (3, 2), lambda *what: told.append(what)), told


@pytest.fixture(scope="module")
def loaded(traced: tuple[Diagnosis, list[tuple[str, int, int]]]) -> Diagnosis:
    return traced[0]


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


@pytest.mark.moderate
def test_every_candidate_is_named_or_rejected_and_who_was_carried_is_told_with_its_gain(loaded: Diagnosis) -> None:
    named = {"cubic_stiffness", "kxx by load_kg"}
    rejected = {one.name: one.reason for one in loaded.rejected}
    assert len(loaded.rejected) == len(rejected)
    assert not named & set(rejected)
    assert {"cubic_isotropic", "sense_cubic", "drag", "dxx by load_kg", "k3x by load_kg"} <= set(rejected)
    assert rejected["drag"].endswith("does not outweigh its coefficients")
    assert "carried, it gains" in rejected["cubic_isotropic"]
    # On one axis a spring that hardens along the radius is one that hardens along the axis.
    ((effect, other, likeness),) = ((one.effect, one.other, one.correlation) for one in loaded.separations)
    assert (effect, other, likeness) == ("cubic_stiffness", "cubic_isotropic", pytest.approx(1.0))
    cubic, load = loaded.probabilities
    assert cubic.probabilities["cubic_stiffness"] == pytest.approx(cubic.probabilities["cubic_isotropic"], rel=0.01)
    assert load.probabilities["kxx by load_kg"] > 0.99
    assert set(rejected) <= set(cubic.probabilities) | set(load.probabilities)  # carried or not
    assert cubic.probabilities["drag"] < 1e-30
    for one in loaded.probabilities:
        assert sum(one.probabilities.values()) == pytest.approx(1.0)


@pytest.mark.moderate
def test_what_is_left_is_told_of_all_samples_and_apart_of_those_that_were_held_out(loaded: Diagnosis) -> None:
    assert loaded.split == 4 * 320
    was, now = loaded.residual_before.innovation, loaded.residual_after.innovation
    assert was.shape == now.shape == (6 * 320, 1)
    for residual in (loaded.residual_before, loaded.residual_after):  # no spectrum is shown of several records
        assert (residual.frequency.shape, residual.density.shape) == ((0,), (0, 1))
    for fit, part in (
        (loaded.before, was[: 4 * 320]), (loaded.after, now[: 4 * 320]),
        (loaded.held_out_before, was[4 * 320 :]), (loaded.held_out_after, now[4 * 320 :]),
    ):  # fmt: skip
        assert fit.innovation_rms == (pytest.approx(np.sqrt(np.nanmean(part**2))),)
        assert (fit.noise_floor, fit.simulation_rmse) == ((NOISE,), fit.innovation_rms[0])
        assert fit.ratio == pytest.approx(fit.innovation_rms[0] / NOISE)
    assert np.flatnonzero(np.isnan(now[:, 0])).tolist() == [
        4 * 320 + 320 * record + row for record in range(2) for row in range(80)
    ]
    assert loaded.share == pytest.approx(1.0, abs=1e-5)
    cubic, load = loaded.effects[0], loaded.dependences[0]
    assert cubic.coefficients["k3x"].unit == "1/(m²·s²)"
    assert (load.value.unit, load.slope.unit) == ("1/s²", "1/s²")
    assert load.evidence > cubic.evidence > 100.0


@pytest.mark.moderate
def test_it_is_told_how_far_a_trace_of_several_is(traced: tuple[Diagnosis, list[tuple[str, int, int]]]) -> None:
    """Each stage from nothing to its end; those who are carried in a round are told one after another."""
    told = traced[1]
    stages: dict[str, list[tuple[int, int]]] = {}
    for stage, done, total in told:
        stages.setdefault(stage, []).append((done, total))
    assert list(stages) == ["records by themselves", "free runs", "candidates", "refinement"]
    assert stages["records by themselves"] == [(0, 4), *((done, 4) for done in range(1, 5))]
    assert [done for done, _ in stages["free runs"]] == [0, 1, 2]
    assert all(0 < done <= total <= 3 for done, total in stages["candidates"])
    assert stages["refinement"] == [(0, 2), (1, 2), (2, 2)]
    assert told[-1] == ("refinement", 2, 2)


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


def test_a_record_of_which_nothing_is_said_has_a_covariate_of_zero() -> None:
    assert Member("run", NO_SAMPLES) == Member("run", NO_SAMPLES, 0.0)


def test_without_a_covariate_nothing_is_scaled() -> None:
    level = Level.of(pool([Member(str(i), NO_SAMPLES, 3.0) for i in range(3)], None))
    assert (level.mean, level.spread, level.scaled(3.0)) == (0.0, 1.0, 3.0)
    level = Level.of(pool([Member(str(i), NO_SAMPLES, i) for i in (1.0, 2.0, 6.0)], "load_kg"))
    assert level.scaled(3.0 + np.std([1.0, 2.0, 6.0])) == pytest.approx(1.0)


@pytest.mark.moderate
def test_too_few_records_are_refused() -> None:
    rng = np.random.default_rng(8)
    members = [Member(f"run {i}", decay(rng, 1e-3)) for i in range(2)]
    with pytest.raises(ModelError, match="1 records to fit and 1 to judge"):
        trace_pool(pool(members, None), (1,))


@pytest.mark.parametrize(("number", "expected"), [(1, 1), (2, 1), (3, 1), (6, 2), (12, 4)])
def test_by_default_a_third_judges_from_within(number: int, expected: int) -> None:
    values = np.random.default_rng(1).permutation(number)
    members = [Member(str(v), NO_SAMPLES, float(v)) for v in values]
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


def test_of_six_the_third_and_the_fifth_judge() -> None:
    members = [Member(str(load), NO_SAMPLES, load) for load in (5.0, 2.0, 9.0, 1.0, 7.0, 3.0)]
    assert [members[place].covariate for place in held_out_by_default(pool(members, "load_kg"))] == [7.0, 3.0]


def alone_with(*values: float, deviation: float) -> Any:
    """As if each record by itself had been fitted with such a constant."""
    return [SimpleNamespace(names=["k"], deviation=np.array([deviation]), value=lambda name, v=v: v) for v in values]


def test_two_records_make_a_line_where_what_each_leaves_open_does_not_and_three_may_lie_on_one() -> None:
    """Of two there is no scatter, and of three on a line none is left."""
    two, three = np.array([-1.0, 1.0]), np.array([-1.0, 0.0, 1.0])
    assert pool_trace._line(two, alone_with(4.0, 6.0, deviation=0.01), "k") == (5.0, 1.0)
    assert pool_trace._line(two, alone_with(4.0, 6.0, deviation=1.0), "k") is None
    assert pool_trace._line(three, alone_with(4.0, 5.0, 6.0, deviation=0.01), "k") == (5.0, 1.0)
    assert pool_trace._line(three, alone_with(4.0, 5.0, 6.0, deviation=1.0), "k") is None


class Enough(Exception):
    """What was to be seen was seen."""


@pytest.mark.moderate
def test_candidates_of_a_pool_are_chosen_on_two_thirds_and_lines_that_were_looked_for_compete_unless_declared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lines = {"free_mode": {"wm": 300.0}, "sense_cubic": {}}
    asked: list[Any] = []

    def begun(device: Device, names: Any, residuals: Any) -> Any:
        asked.append((names, [len(one) for one in residuals]))
        return lines

    def choose(model: PooledModel, start: PooledRun, rules: Any, progress: Any) -> Any:
        asked.append((model, start))
        raise Enough

    monkeypatch.setattr(pool_trace, "rings_begun", begun)
    monkeypatch.setattr(pool_trace, "choose", choose)
    several = pool(linear_decays(np.random.default_rng(11)), "load_kg")
    declares = replace(several.settings, effects={"sense_cubic": {"a3x": 0.0}})
    with pytest.raises(Enough):
        trace_pool(replace(several, settings=declares, asked=("free_mode",)), (0,))
    (looked, (model, start)) = asked
    assert looked == (("free_mode",), [160, 160])
    assert model.pool.begun == lines
    assert model.names[-1] == "free_mode"
    assert "sense_cubic" not in model.names
    assert model.names.count("free_mode") == 1
    assert start.effects == ("sense_cubic",)
    assert len(model.pool.members) == 2
    for choice, later in zip(model.choice.masks, model.later.masks, strict=True):
        np.testing.assert_array_equal(choice, ~later)  # each sample is of one of the two
        assert np.mean(choice) == pytest.approx(2.0 / 3.0, abs=0.04)  # in blocks


class Refitted:
    """In the place of fits: which effects and slopes, from which start, and whether to the end."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[Any] = []
        monkeypatch.setattr(pool_trace, "fitted", self)

    def __call__(
        self, several: Any, effects: Any, slopes: Any, start: Any, rows: Any, *, in_earnest: bool = False
    ) -> Any:
        self.asked.append(SimpleNamespace(effects=effects, slopes=slopes, start=start, rows=rows, earnest=in_earnest))
        return SimpleNamespace(effects=effects, slopes=dict.fromkeys(slopes, 0.5))


def test_who_goes_takes_along_what_of_it_depends_on_the_covariate(monkeypatch: pytest.MonkeyPatch) -> None:
    fits = Refitted(monkeypatch)
    several, rows = pool([], "load_kg"), Rows(())
    run: Any = SimpleNamespace(effects=("cubic_stiffness", "drag"), slopes={"kxx": 1.0, "k3x": 2.0, "dqx": 3.0})
    left = pool_trace._without(several, run, "cubic_stiffness", rows)
    assert (left.effects, tuple(left.slopes)) == (("drag",), ("kxx", "dqx"))
    left = pool_trace._without(several, run, "kxx by load_kg", rows, in_earnest=True)
    assert (left.effects, tuple(left.slopes)) == (("cubic_stiffness", "drag"), ("k3x", "dqx"))
    assert all(one.start is run and one.rows is rows for one in fits.asked)
    assert [one.earnest for one in fits.asked] == [False, True]


def test_what_its_own_guard_speaks_against_goes_and_what_was_never_chosen_says_what_it_explains(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not what the bench file declares.  Of a slope that was there from the start no round has told a gain."""
    fits = Refitted(monkeypatch)
    monkeypatch.setattr(
        pool_trace, "estimates_of",
        lambda run, covariate: {name: {} for name in (*run.effects, *(f"{c} by {covariate}" for c in run.slopes))},
    )  # fmt: skip
    weak = {"drag": "may be nothing", "sense_cubic": "is declared", "dxx by load_kg": "may be nothing, too"}
    monkeypatch.setattr(pool_trace.promises, "weak", lambda named: {name: weak[name] for name in named if name in weak})
    monkeypatch.setattr(pool_trace, "gain_of", lambda less, more, rows: (set(more.slopes) - set(less.slopes), rows))
    begun = replace(as_made(pool(linear_decays(np.random.default_rng(1)), "load_kg")), slopes={"d": 1.0})
    best = SimpleNamespace(
        effects=("sense_cubic", "cubic_stiffness", "drag"), slopes={"kxx": 1.0, "dxx": 2.0, "k3x": 3.0}
    )
    chosen: Any = SimpleNamespace(fit=best, gains={"cubic_stiffness": 50.0, "drag": 9.0, "kxx by load_kg": 30.0})
    several, whole = pool([], "load_kg"), Rows(())
    found: Any = pool_trace._refined(several, ("sense_cubic",), begun, chosen, whole)
    assert (found.before.effects, found.before.slopes) == (("sense_cubic",), {})
    assert fits.asked[0].start.slopes == {}
    assert (found.after.effects, set(found.after.slopes)) == (("sense_cubic", "cubic_stiffness"), {"kxx", "k3x"})
    assert found.why == {"drag": "may be nothing", "dxx by load_kg": "may be nothing, too"}
    assert found.evidence == {
        "cubic_stiffness": 50.0, "kxx by load_kg": 30.0, "k3x by load_kg": ({"k3x"}, whole),
    }  # fmt: skip
    assert [one.earnest for one in fits.asked] == [False, True, True, True, False]


def test_a_pair_is_alike_by_its_signature_or_because_it_came_as_near() -> None:
    """Who shows nothing of its own is like nobody, and nobody is like itself."""
    t = np.linspace(0.0, 1.0, 50)
    wave, other = np.cos(9.0 * t)[:, None], np.cos(21.0 * t)[:, None]
    signatures = {
        "cubic_stiffness": wave, "like": -3.0 * wave + 1e-6 * other, "both": np.hstack([other, wave + other]),
        "unlike": other, "near": other, "nothing": wave[:, :0], "near nothing": wave[:, :0],
    }  # fmt: skip
    several = pool(linear_decays(np.random.default_rng(1)), None)
    run = replace(
        as_made(several), effects=("cubic_stiffness",), observer=observer_of(several, ("cubic_stiffness",)),
        shared=as_made(several).shared | {"k3x": K3}, slopes={"k3x": 7.0, "kxx": 8.0},
    )  # fmt: skip
    asked: list[Any] = []

    def promised(reduced: PooledRun, left: Any, shown: str, held: Any) -> Any:
        asked.append((reduced, shown, held))
        return {name: Promise(1.0, 1.0, signatures[name]) for name in left}

    model: Any = SimpleNamespace(pool=several, names=tuple(signatures), promised=promised)
    near = {"cubic_stiffness": ("near", "near nothing")}
    found = pool_trace._alike(model, run, ("cubic_stiffness",), near)
    assert [(one.effect, one.other) for one in found] == [
        ("cubic_stiffness", "like"), ("cubic_stiffness", "both"), ("cubic_stiffness", "near"),
    ]  # fmt: skip
    likeness = abs(float(wave[:, 0] @ other[:, 0])) / float(np.linalg.norm(wave) * np.linalg.norm(other))
    assert [one.correlation for one in found] == pytest.approx([1.0, 1.0, likeness])
    ((reduced, shown, held),) = asked
    assert (reduced.effects, reduced.slopes, shown, held) == ((), {"kxx": 8.0}, "cubic_stiffness", {"k3x": K3})
    assert set(reduced.shared) == set(as_made(several).shared)
    signatures["cubic_stiffness"] = wave[:, :0]
    assert pool_trace._alike(model, run, ("cubic_stiffness",), near) == ()


@pytest.mark.parametrize(("said", "was"), [(("drag",), ", was 6 V"), ((), "")])
def test_of_each_judge_it_is_told_how_far_its_free_run_is_off(said: tuple[str, ...], was: str) -> None:
    judges = pool([Member("day 3", NO_SAMPLES, 1.5)], "load_kg")
    errors = (np.array([[np.nan], [6.0], [-6.0]]),), (np.array([[np.nan], [1.0], [7.0]]),)
    first, second = pool_trace._summary(judges, judges, errors, 2e-6, said)
    assert first == "1 records fitted, 1 held out but for where they begin; the declared noise is 2e-06 V"
    assert second == f"a free run of day 3, load_kg = 1.5, which was held out, is 5 V rms off{was}"
    silent = replace(judges, covariate=None)
    assert pool_trace._summary(silent, silent, errors, 1.0, said)[1].startswith("a free run of day 3 which was")


def test_why_each_candidate_is_not_named_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the guard of its own, by the round that barred it, or because its promise was too small."""
    several = pool(linear_decays(np.random.default_rng(11)), "load_kg")
    begin = as_made(several)
    rng = np.random.default_rng(5)
    left = tuple(rng.normal(0.0, NOISE, (160, 1)) for _ in range(3))
    run = replace(begin, residual=left)
    judged_off = (np.where(np.arange(160)[:, None] < 40, np.nan, rng.normal(0.0, NOISE, (160, 1))),)
    contests: list[Any] = []
    real = pool_trace.contest

    def noting(was: Any, now: Any, split: int) -> Any:
        contests.append((was.fitted, now.fitted, split))
        return real(was, now, split)

    monkeypatch.setattr(pool_trace, "contest", noting)
    look = {name: Promise(gain, 9.0, np.zeros((0, 1))) for name, gain in (("drag", 1.25), ("barred", 20.0))}
    chosen: Any = SimpleNamespace(
        barred={"barred": "has no model", "weak": "was barred, too"}, rounds=(Round(look, (), None),)
    )
    models = pool_trace._Models(run, run, {}, {"weak": "may be nothing"})
    judges = several.of(several.members[:1])
    model: Any = SimpleNamespace(pool=several, names=("drag", "barred", "weak"))
    found = pool_trace._diagnosis(several, judges, model, chosen, models, (judged_off, judged_off))
    assert found.verdict is Verdict.ADEQUATE
    assert {one.name: one.reason for one in found.rejected} == {
        "drag": "evidence 1.2 does not outweigh its coefficients",
        "barred": "has no model",
        "weak": "may be nothing",
    }
    assert len(found.rejected) == 3
    assert (found.effects, found.dependences, found.separations, found.share) == ((), (), (), None)
    assert found.split == 480
    assert contests == [(slice(0, 480), slice(0, 480), 480)]


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
    assert twin.found.deviation["dxx"] == pytest.approx(sd, rel=0.2)
    as_it_is = beside(NOISE, 2e-3)
    assert twin.found.deviation["dxx"] == pytest.approx(as_it_is.found.deviation["dxx"], rel=0.05)


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
    # What is declared exactly is no more and no less than that.
    assert found.deviation["drive_gain_x"] == 0.0
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


# -- where a fit begins, and what of it is first -----------------------------------------------------------------------


class Solver:
    """In the place of the least squares: stays where it begins, or goes where it is told; keeps what it was asked."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[Any] = []
        monkeypatch.setattr(pool_fit, "least_squares_beside", self)

    def __call__(self, rows: Any, begin: Any, places: Any, known: Any, sure: Any, **how: Any) -> Any:
        assert len(places) == len(known) == len(sure)
        moved = tuple(np.flatnonzero(np.any(rows(begin)[1] != 0.0, axis=0)).tolist())
        self.asked.append(SimpleNamespace(moved=moved, begin=begin, rows=rows, sure=sure, **how))
        return begin


def as_made(several: Pool) -> PooledRun:
    """As if each record of `linear_decays` had been fitted by itself, and every one found what it was made with."""
    observer = observer_of(several, ())
    shared = dict(zip(observer.names, observer.state.tolist(), strict=True)) | {"kxx": K, "dxx": D}
    own = np.array([[*start, offset] for start, offset in zip(STARTS, OFFSETS, strict=True)])
    shared = {name: shared[name] for name in shared_names(observer)}
    return PooledRun((), observer, Level.of(several), own, shared, {}, {}, (), {})


def everything(several: Pool) -> Rows:
    return Rows(tuple(np.ones(len(member.record), dtype=bool) for member in several.members))


def test_a_fit_begins_with_what_was_found_and_with_nothing_of_what_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    several = pool(linear_decays(np.random.default_rng(11)), "load_kg")
    begin, solver = as_made(several), Solver(monkeypatch)
    found = fitted(several, (), ("kxx",), begin, everything(several))
    assert found.slopes == {"kxx": 0.0}
    assert found.shared == pytest.approx(begin.shared)
    np.testing.assert_allclose(found.own, begin.own)
    slanted = fitted(several, (), ("kxx",), replace(begin, slopes={"kxx": PER_KG}), everything(several))
    assert slanted.slopes == {"kxx": pytest.approx(PER_KG)}
    # What only leads to the next is fitted to five digits by a dozen free runs at most.
    assert [(one.tolerance, one.runs) for one in solver.asked] == [(1e-5, 12)] * 2


def test_in_earnest_a_fit_goes_on_to_nine_digits_with_what_is_declared_worth_more_where_much_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside residuals that are some times the declared noise, their correlation included, a declaration counts so
    many times as sure.
    """
    several = pool(linear_decays(np.random.default_rng(11)), "load_kg")
    sure = replace(several.settings, spread=replace(several.settings.spread, damping=0.1))
    solver = Solver(monkeypatch)
    fitted(replace(several, settings=sure), (), (), as_made(several), everything(several), in_earnest=True)
    first, second = solver.asked  # of stiffnesses that are other much is left
    assert (first.tolerance, first.runs) == (second.tolerance, second.runs) == (1e-9, 60)
    times = first.sure / second.sure
    assert times == pytest.approx(np.full(len(times), times[0]))
    assert times[0] > 10.0


@pytest.mark.parametrize(
    ("effect", "sizes"),
    [
        ("hysteretic_stiffness", ["khx"]),  # not how far it reaches
        ("free_mode", ["cmx", "smx"]),  # of each record; not where its line is, and how fast it dies away
        ("cubic_stiffness", None),  # has no shape
    ],
)
def test_of_an_effect_with_a_shape_first_its_size_is_fitted_while_all_else_is_held(
    monkeypatch: pytest.MonkeyPatch, effect: str, sizes: list[str] | None
) -> None:
    several = pool(linear_decays(np.random.default_rng(11)), None)
    solver = Solver(monkeypatch)
    found = fitted(several, (effect,), (), as_made(several), everything(several))
    own = own_names(found.observer)
    free = [name for name in shared_names(found.observer) if name in unsettled(found.observer)]
    unknowns = [*(f"{name} of {record}" for record in range(3) for name in own), *free]
    *first, last = [[unknowns[place] for place in one.moved] for one in solver.asked]
    assert {"x of 0", "x of 2", "kxx", "dxx"} <= set(last)
    if sizes is None:
        assert not first
        return
    (moved,) = first
    assert set(moved) == {one for one in unknowns if one.partition(" ")[0] in sizes}
    assert solver.asked[0].sure.size == 0  # nothing is declared of a size
    assert (solver.asked[0].tolerance, solver.asked[0].runs) == (1e-5, 12)
    begin, solver.asked = found, []
    fitted(several, (effect,), (), begin, everything(several))
    assert len(solver.asked) == 1  # it is not new any more


@pytest.mark.parametrize("name", ["kxx", "dxx"])
def test_a_slope_moves_a_record_as_its_constant_does_times_the_covariate(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    several = pool(linear_decays(np.random.default_rng(11)), "load_kg")
    solver = Solver(monkeypatch)
    fitted(several, (), (name,), as_made(several), everything(several))
    jacobian = solver.asked[0].rows(solver.asked[0].begin)[1]
    z = np.repeat((np.array(LOADS) - np.mean(LOADS)) / np.std(LOADS), 160)
    constant = jacobian[:, 9 + ["kxx", "dxx"].index(name)]
    assert np.all(np.any(constant.reshape(3, 160) != 0.0, axis=1))
    np.testing.assert_allclose(jacobian[:, -1], z * constant, atol=1e-12 * np.max(np.abs(constant)))


def test_a_length_that_must_not_vanish_stays_above_its_least_and_nothing_else_is_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A reach begins with a fifth of the amplitude; a hundredth is the least."""
    several = pool(linear_decays(np.random.default_rng(11)), "load_kg")
    solver = Solver(monkeypatch)
    found = fitted(several, ("hysteretic_stiffness",), ("kxx",), as_made(several), everything(several))
    one = solver.asked[-1]
    free = [name for name in shared_names(found.observer) if name in unsettled(found.observer)]
    place = 9 + free.index("reach")
    assert np.flatnonzero(np.isfinite(one.least)).tolist() == [place]
    assert one.least[place] / one.begin[place] == pytest.approx(0.05)
    assert np.all(one.least <= one.begin)


def test_a_fit_is_turned_back_from_where_a_record_has_no_free_run_and_does_not_begin_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    several = pool(linear_decays(np.random.default_rng(11)), None)
    solver = Solver(monkeypatch)
    begin = as_made(several)
    fitted(several, (), (), begin, everything(several))
    (one,) = solver.asked
    free = [name for name in shared_names(begin.observer) if name in unsettled(begin.observer)]
    away = one.begin.copy()
    away[9 + free.index("kxx")] *= -1000.0
    here, there = one.rows(one.begin), one.rows(away)
    assert [each.shape for each in here] == [each.shape for each in there] == [(480,), (480, 9 + len(free))]
    assert np.all(there[0] == 1e6)  # far more than any that has one
    assert not there[1].any()
    monkeypatch.undo()
    with pytest.raises(ModelError, match="bounds"):
        fitted(several, (), (), replace(begin, shared={**begin.shared, "kxx": -1000.0 * K}), everything(several))


def test_what_was_lost_of_a_record_is_no_residual(monkeypatch: pytest.MonkeyPatch) -> None:
    members = linear_decays(np.random.default_rng(11))
    members[1].record.sense[40:70] = np.nan
    several = pool(members, None)
    solver = Solver(monkeypatch)
    rows = Rows((np.arange(160) < 150, np.arange(160) < 150, np.arange(160) < 100))
    fitted(several, (), (), as_made(several), rows)
    residual, jacobian = solver.asked[0].rows(solver.asked[0].begin)
    assert residual.shape == (150 + 120 + 100,)
    assert np.isfinite(residual).all()
    assert np.isfinite(jacobian).all()


@pytest.mark.parametrize(("same", "deviation"), [(False, np.std(OFFSETS)), (True, 0.1 * NOISE)])
@pytest.mark.parametrize(("samples", "first"), [(160, 50), (400, 100)])
def test_a_judge_begins_with_its_first_quarter_and_the_offsets_of_those_that_were_fitted(
    monkeypatch: pytest.MonkeyPatch, samples: int, first: int, *, same: bool, deviation: float
) -> None:
    """Its motion is its own; no offset is known better than to a tenth of the noise, and fifty samples are needed."""
    asked: list[Any] = []

    def refined(observer: Any, sense: Any, drive: Any, *, start: Any, free: Any, step: Any, known: Any) -> Any:
        asked.append(SimpleNamespace(sense=sense, start=start, free=free, known=known))
        return SimpleNamespace(state=start)

    monkeypatch.setattr(pool_fit, "refine", refined)
    members = linear_decays(np.random.default_rng(11), samples)
    several = pool(members, "load_kg")
    run = as_made(several)
    if same:
        run.own[:, 2] = np.mean(OFFSETS)
    (error, *_) = error_on(run, several)
    judge = asked[0]
    np.testing.assert_array_equal(judge.sense, members[0].record.sense[:first])
    assert np.isnan(error[:first]).all()
    assert np.isfinite(error[first:]).all()
    assert set(judge.free) == {"x", "vx", "phi_x"}
    assert judge.start[:2].tolist() == [0.0, 0.0]
    assert judge.start[run.observer.names.index("phi_x")] == pytest.approx(np.mean(OFFSETS))
    assert set(judge.known) == {"phi_x"}
    assert (judge.known["phi_x"].value, judge.known["phi_x"].deviation) == pytest.approx((np.mean(OFFSETS), deviation))


def test_a_fit_that_nobody_waits_for_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    def abandoned() -> None:
        raise Abandoned

    several = pool(linear_decays(np.random.default_rng(11)), None)
    monkeypatch.setattr(pool_fit, "stop_if_abandoned", abandoned)
    with pytest.raises(Abandoned):
        fitted(several, (), (), as_made(several), everything(several))


def test_beside_a_noise_that_is_declared_too_large_a_declaration_counts_for_no_less_than_it_is_sure() -> None:
    """The deviation of least squares with weights W, of observations whose covariance is S (Aitken, Proc. Roy. Soc.
    Edinburgh 55, 1935): (JᵀWJ)⁻¹ JᵀW S WJ (JᵀWJ)⁻¹.
    """
    times = 5.0
    twin = beside(times * NOISE, 2e-3)
    jacobian = twin.jacobian  # over the noise as it is; the last two are of what is declared
    weight = np.full(len(jacobian), times**-2)
    weight[-2:] = 1.0
    inverse = np.linalg.inv(jacobian.T @ (weight[:, None] * jacobian))
    covariance = inverse @ (jacobian.T @ (weight[:, None] ** 2 * jacobian)) @ inverse
    assert twin.found.deviation["dxx"] == pytest.approx(np.sqrt(covariance[10, 10]) * D, rel=0.2)


# -- what a candidate promises, beside what it gains when it is fitted -----------------------------------------------


def slightly_cubic() -> tuple[PooledModel, PooledRun]:
    """Three decays with a cubic spring and a load that are just seen."""
    rng = np.random.default_rng(21)
    members = [
        Member(f"load {load}", decay(rng, start, K + 0.005 * PER_KG * load, 0.004 * K3, 200), load)
        for load, (start, _) in zip(LOADS, STARTS, strict=True)
    ]
    several = pool(members, "load_kg")
    rows = everything(several)
    model = PooledModel(several, rows, rows, ("cubic_stiffness", "sense_cubic"))
    own = np.array([[start, 0.0, 0.0] for start, _ in STARTS])
    return model, fitted(several, (), (), replace(as_made(several), own=own), rows)


@pytest.mark.moderate
def test_what_a_candidate_promises_is_about_what_it_gains_when_it_is_fitted() -> None:
    """Where it is small: one free run at first order, beside the least squares with it; in samples that are worth as
    many as those of what is left without it.
    """
    model, current = slightly_cubic()
    look = model.promise(current, ())
    assert set(look) == {"cubic_stiffness", "sense_cubic", "kxx by load_kg", "dxx by load_kg"}
    names = ("cubic_stiffness", "kxx by load_kg")
    fits = model.fit(current, look, names, {})
    assert not any(isinstance(fit, str) for fit in fits.values())
    trials: Any = fits
    scores = model.score(current, look, trials)
    before = np.concatenate(current.residual)[:, 0]
    for name in names:
        after = np.concatenate(trials[name].residual)[:, 0]
        expected = effective_samples(before) * np.log(np.mean(before**2) / np.mean(after**2))
        assert 20.0 < expected < 100.0
        assert look[name].gain == pytest.approx(expected, rel=0.05)
        assert scores[name].price == look[name].price
    assert look["sense_cubic"].gain < 1.0


@pytest.mark.moderate
def test_of_what_is_driven_a_promise_is_of_what_the_free_runs_leave() -> None:
    """Of a decay what is sensed is a sum of its own derivatives, by the scale of its lengths, and sets itself off; a
    drive of known size has no such scale.
    """
    rng = np.random.default_rng(22)
    members = []
    for load in LOADS:
        equations = np.array([[0.0, 1.0], [-(K + 0.005 * PER_KG * load), -D]]), np.array([[0.0], [1.0]])
        step, push, *_ = cont2discrete((*equations, np.eye(2), np.zeros((2, 1))), 1.0 / RATE)
        drive, state, sensed = 2.0 * rng.standard_normal(200), np.array([1e-3, 0.0]), []
        for force in drive:  # of the interval before its sample
            state = step @ state + push[:, 0] * force if sensed else state
            sensed.append(state[0] + rng.normal(0.0, NOISE))
        record = Record(np.array(sensed)[:, None], drive[:, None, None], np.full(200, 1.0 / RATE))
        members.append(Member(f"load {load}", record, load))
    several = pool(members, "load_kg")
    rows = everything(several)
    begin = replace(as_made(several), own=np.array([[1e-3, 0.0, 0.0]] * 3))
    current = fitted(several, (), (), begin, rows)
    more = fitted(several, (), ("kxx",), current, rows)
    before, after = (np.concatenate(run.residual)[:, 0] for run in (current, more))
    expected = effective_samples(before) * np.log(np.mean(before**2) / np.mean(after**2))
    assert 20.0 < expected < 150.0
    found = PooledModel(several, rows, rows, ()).promise(current, ())
    assert found["kxx by load_kg"].gain == pytest.approx(expected, rel=0.1)


def test_a_record_of_which_no_sample_counts_promises_nothing() -> None:
    """The others say what they say without it."""
    model, current = slightly_cubic()
    whole = model.choice.masks[0]
    blind = replace(model, choice=Rows((whole, ~whole, whole)))
    two = replace(model, pool=model.pool.of(model.pool.members[::2]), choice=Rows((whole, whole)))
    looks = blind.promise(current, ()), two.promise(replace(current, own=current.own[::2]), ())
    for name in ("cubic_stiffness", "kxx by load_kg"):
        promises = [look[name].gain for look in looks]
        assert promises[0] == pytest.approx(promises[1], rel=0.05)
        assert promises[0] > 20.0


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("known", [False, True])
def test_a_promise_is_what_regression_beside_all_that_is_carried_would_explain(*, known: bool, hidden: bool) -> None:
    """By SciPy.  A column that hardly shows beside what is carried promises nothing, unless it is known to be there."""
    rng = np.random.default_rng(31)
    basis = np.linalg.qr(rng.standard_normal((60, 3)))[0]
    columns = rng.standard_normal((60, 2))
    if hidden:
        columns[:, 1] = basis @ (1.0, 2.0, 3.0) + 1e-3 * THRESHOLDS.free_runs.visible * rng.standard_normal(60)
    residual = columns @ (0.3, 0.0 if hidden else -0.2) + rng.standard_normal(60)
    residual -= basis @ (basis.T @ residual)
    seen = columns[:, :1] if hidden and not known else columns
    beside = np.hstack([basis, seen])
    left = residual - beside @ lstsq(beside, residual)[0]
    found = pool_model._promise(columns, basis, residual, float(residual @ residual), 45.0, 7, known=known)
    assert found.gain == pytest.approx(45.0 * np.log((residual @ residual) / (left @ left)))
    assert found.price == pytest.approx(2.0 * np.log(45.0) + 2.0 * np.log(7.0))
    np.testing.assert_allclose(found.signature, seen - basis @ (basis.T @ seen), atol=1e-12)


def test_what_shows_nothing_promises_nothing_and_what_explains_all_a_number() -> None:
    basis = np.eye(9)[:, :2]
    nothing = pool_model._promise(basis[:, :1], basis, np.ones(9), 9.0, 9.0, 5, known=False)
    assert (nothing.gain, nothing.signature.shape) == (0.0, (9, 0))
    residual = np.array([0.0, 0.0, *np.ones(7)])
    everything_ = pool_model._promise(3.0 * residual[:, None], basis, residual, 7.0, 9.0, 5, known=False)
    assert 200.0 < everything_.gain < np.inf


def test_the_three_that_promise_most_for_their_price_are_tried() -> None:
    nothing = np.zeros((0, 1))
    names = ("a", "b", "c", "d", "e")
    gains, prices = (50.0, 49.0, 60.0, 10.0, 30.0), (8.0, 4.0, 30.0, 1.0, 2.0)  # ahead by 42, 45, 30, 9, 28
    look = {name: Promise(gain, price, nothing) for name, gain, price in zip(names, gains, prices, strict=True)}
    made: Any = None
    assert list(PooledModel.hopeful(made, look, {}, (), 0)) == ["b", "a", "c"]


def test_the_samples_without_a_vote_have_to_be_predicted_better() -> None:
    def off(by: float) -> Any:
        return SimpleNamespace(spread_out=lambda rows: np.array([by, -by, np.nan]) if rows == "later" else None)

    rows: Any = "later"
    several: Any = None
    model = PooledModel(several, rows, rows, ())
    assert model.objection(off(2.0), "drag", Trial(off(1.9), Score(0.0, 9.0, 1.0, 1.0))) is None
    for by in (2.0, 2.1):
        said = model.objection(off(2.0), "drag", Trial(off(by), Score(0.0, 9.0, 1.0, 1.0)))
        assert said == "fits two thirds of the samples better and the other third worse"


def test_candidates_are_what_is_not_carried_and_what_may_go_with_the_covariate_and_does_not_yet() -> None:
    several = pool(linear_decays(np.random.default_rng(1)), "load_kg")
    run = replace(as_made(several), effects=("drag",), slopes={"dxx": 1.0})
    rows = everything(several)
    model = PooledModel(several, rows, rows, ("cubic_stiffness", "drag", "dry_friction"))
    assert model.candidates(run, ()) == ["cubic_stiffness", "dry_friction", "kxx by load_kg"]
    assert model.candidates(run, ("dry_friction", "kxx by load_kg")) == ["cubic_stiffness"]
    assert replace(model, pool=replace(several, covariate=None)).candidates(run, ()) == [
        "cubic_stiffness",
        "dry_friction",
    ]


def test_what_has_no_free_run_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the others, which are fitted from what is carried; what depends on the covariate as a slope more."""
    asked: list[Any] = []

    def refused(several: Pool, effects: tuple[str, ...], slopes: tuple[str, ...], start: Any, rows: Any) -> Any:
        asked.append((effects, slopes, start is run, rows is choice))
        if "drag" in effects:
            raise ModelError("it leaves all bounds")
        return "fitted"

    monkeypatch.setattr(pool_model, "fitted", refused)
    several = pool(linear_decays(np.random.default_rng(1)), "load_kg")
    run = replace(as_made(several), effects=("sense_cubic",), slopes={"dxx": 1.0})
    choice, told = everything(several), []
    model = PooledModel(several, choice, choice, ("drag",), lambda *what: told.append(what))
    found = model.fit(run, {}, ("drag", "kxx by load_kg"), {})
    assert found == {"drag": "no free run with it stays within bounds", "kxx by load_kg": "fitted"}
    assert asked == [
        (("sense_cubic", "drag"), ("dxx",), True, True), (("sense_cubic",), ("dxx", "kxx"), True, True)
    ]  # fmt: skip
    assert told == [("candidates", 1, 2), ("candidates", 2, 2)]


def test_what_was_promised_and_not_carried_counts_less_its_price() -> None:
    assert pool_trace._promised({"drag": Promise(9.0, 4.0, np.zeros((0, 1)))}) == {"drag": 5.0}


def test_a_constant_and_its_slope_have_names_of_their_own() -> None:
    names = ("kxx", "dxx", "k3x")
    assert len({*names, *map(slope_name, names)}) == 6


def test_estimates_are_of_what_records_share_and_know_what_must_be_positive_and_what_is_a_shape() -> None:
    several = pool(linear_decays(np.random.default_rng(1)), "load_kg")
    observer = observer_of(several, ("hysteretic_stiffness", "free_mode"))
    names = shared_names(observer)
    run = replace(
        as_made(several), observer=observer, effects=("hysteretic_stiffness", "free_mode"),
        shared={name: 1.0 + place for place, name in enumerate(names)}, slopes={"kxx": 6.0},
        deviation={**dict.fromkeys(names, 0.5), slope_name("kxx"): 0.25},
    )  # fmt: skip
    found = pool_model.estimates_of(run, "load_kg")
    assert {name: list(given) for name, given in found.items()} == {
        "hysteretic_stiffness": ["khx", "reach"], "free_mode": ["wm", "dm"], "kxx by load_kg": ["kxx"],
    }  # fmt: skip
    size, reach = found["hysteretic_stiffness"].values()
    assert (size.positive, size.shape, reach.positive, reach.shape) == (True, False, True, True)
    assert size.value == run.shared["khx"]
    assert size.high - size.low == pytest.approx(2.0 * 1.96 * 0.5, rel=1e-3)
    assert found["kxx by load_kg"]["kxx"].value == pytest.approx(6.0 / np.std(LOADS))
