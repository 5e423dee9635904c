"""What is said of a single axis or a free response (docs/reference/trace.md), from what its free run found."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from estimator.diagnosis import Finding, Fit, Separation, Verdict
from estimator.identification.problem import Problem
from estimator.observer import Observer
from estimator.record import Record
from estimator.refinement import Refined
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.simulation import simulate
from estimator.thresholds import THRESHOLDS
from estimator.trace import free_run
from estimator.trace.by_simulation import SimulationTrace
from estimator.trace.engine import Estimate
from estimator.trace.free_run import judged
from estimator.trace.probability import Account
from estimator.trace.promises import Claim, Errors

RATE, N, SPLIT = 600.0, 500, 300
DEVICE = Device(sample_rate=RATE, stiffness=(1.9e5,), damping=(40.0,), amplitude=0.1, sense_gain=(2.0,), noise=(1e-4,))
SETTINGS = ObserverSettings(gain=Gain.EKF, spread=Spread(offset=0.01, stiffness=0.05, damping=0.5, drive_gain=0.1))
CARRYING = replace(SETTINGS, effects={"cubic_stiffness": {}})
DRIVE = 1.5e4 * np.random.default_rng(3).standard_normal((N, 1))
TRUE = {"phi_x": 0.004, "kxx": 1.92e5, "dxx": 41.0, "drive_gain_x": 1.0, "k3x": 7e5}
Z = norm.ppf(0.975)


def state_of(observer: Observer, **values: float) -> Any:
    state = observer.state.copy()
    for name, value in values.items():
        state[observer.names.index(name)] = value
    return state


def record() -> Record:
    """Of the model itself, so that a free run that begins well is off by nothing."""
    observer = Observer(DEVICE, CARRYING)
    sense = simulate(observer, state_of(observer, **TRUE, x=0.03, vx=5.0), DRIVE).sensed
    return Record(np.asarray(sense), DRIVE[:, :, None], np.full(N, 1 / RATE))


def refined(observer: Observer, **values: float) -> Refined:
    """What was found: deviations of a hundredth, and not of the gain, which was held."""
    state = state_of(observer, **values)
    free = tuple(name for name in observer.names if name != "drive_gain_x")
    residual = np.full((SPLIT, 1), 2e-4)
    return Refined(observer.names, free, state, 0.01 * np.abs(state), residual, np.array([2e-4]))


def found(*names: str) -> SimulationTrace:
    bare, carrying = Observer(DEVICE, SETTINGS), Observer(DEVICE, CARRYING)
    return SimulationTrace(
        effects=names,
        evidence=dict.fromkeys(names, 900.0),
        observer_before=bare,
        observer=carrying,
        before=refined(bare, kxx=2.1e5, dxx=40.0, phi_x=0.0),
        after=refined(carrying, **TRUE),
        rejected={"drag": "evidence 1.0 does not outweigh its coefficients"},
        alike=(("cubic_stiffness", "cubic_isotropic", 0.999), ("sense_cubic", "drag", 0.99)),
    )


@pytest.mark.moderate
def test_a_free_run_of_the_rest_has_its_own_start_and_the_constants_that_were_found() -> None:
    """Its first samples set the start; the record begins it elsewhere than the fitted part did."""
    observer, later = Observer(DEVICE, CARRYING), record()
    fit = refined(observer, **TRUE, x=-0.5, vx=77.0)
    error = free_run.free_run_error(observer, fit, later, 50)
    assert np.all(np.isnan(error[:50]))
    assert np.max(np.abs(error[50:])) < 1e-7
    off = replace(fit, state=state_of(observer, **(TRUE | {"kxx": 1.93e5})))
    assert np.nanstd(free_run.free_run_error(observer, off, later, 50)) > 1e-3


def test_the_claim_is_about_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = {}

    def contest(was: Any, now: Any, split: int) -> str:
        seen.update(was=was, now=now, split=split)
        return "contest"

    errors = {3: 5e-3, 4: 3e-4}  # by how many are estimated beside the motion: without the effect, with it

    def error(observer: Observer, fit: Refined, later: Record, first: int) -> Any:
        size = errors[len(observer.names) - observer.states - 1]
        return np.where(np.arange(len(later))[:, None] < first, np.nan, size)

    monkeypatch.setattr(free_run, "contest", contest)
    monkeypatch.setattr(free_run, "free_run_error", error)
    whole = record()
    part = Problem(whole.part(slice(0, SPLIT)), DEVICE, SETTINGS)
    claim = free_run.claimed(part, found("cubic_stiffness"), whole.part(slice(SPLIT, N)))
    assert (claim.residual.before, claim.residual.after) == (pytest.approx(5e-3), pytest.approx(3e-4))
    assert (claim.residual.floor, claim.residual.samples) == (1e-4, N - SPLIT)
    k3 = claim.effects["cubic_stiffness"]["k3x"]
    assert (k3.value, k3.low, k3.high) == pytest.approx((7e5, 7e5 * (1 - 0.01 * Z), 7e5 * (1 + 0.01 * Z)))
    assert claim.contest == "contest"
    assert seen["split"] == SPLIT
    for innovations, size in ((seen["was"], 5e-3), (seen["now"], 3e-4)):
        assert innovations.deviation.shape == innovations.innovation.shape == (N, 1)
        np.testing.assert_array_equal(innovations.innovation[:SPLIT], 2e-4)
        np.testing.assert_array_equal(innovations.innovation[SPLIT + 50 :], size)
        np.testing.assert_array_equal(innovations.deviation, 1e-4)


def test_of_effects_that_a_guard_speaks_against_the_least_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it, nothing speaks against the other any more."""

    def without(part: Problem, trace: Any, names: tuple[str, ...], first: int) -> Any:
        return SimpleNamespace(evidence={name: value for name, value in trace.evidence.items() if name not in names})

    monkeypatch.setattr(free_run, "claimed", lambda part, trace, later: SimpleNamespace(effects=trace.evidence))
    monkeypatch.setattr(free_run, "without", without)
    monkeypatch.setattr(free_run.promises, "weak", lambda names: dict.fromkeys(names, "w") if len(names) > 1 else {})
    monkeypatch.setattr(free_run.promises, "minor", lambda evidence: ())
    both: Any = SimpleNamespace(evidence={"drag": 99.0, "dry_friction": 12.0})
    left, _, why = free_run._promised(Problem(record(), DEVICE, SETTINGS), both, record())
    assert list(left.evidence) == ["drag"]
    assert why == {"dry_friction": "w"}


def test_constants_stand_beside_what_the_bench_file_declares() -> None:
    """Those that were fitted; a gain that was held says nothing, and a coefficient is no constant."""
    constants = {one.name: one for one in free_run._constants(found("cubic_stiffness"))}
    assert set(constants) == {"phi_x", "kxx", "dxx"}
    k = constants["kxx"]
    assert (k.value, k.declared, k.deviation) == (1.92e5, pytest.approx(1.9e5), pytest.approx(0.05 * 1.9e5))
    assert (k.low, k.high) == (pytest.approx(1.92e5 * (1 - 0.01 * Z)), pytest.approx(1.92e5 * (1 + 0.01 * Z)))
    assert {name for name, one in constants.items() if one.positive} == {"kxx", "dxx"}


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The answer where this was found and claimed."""

    def run(trace: SimulationTrace, errors: Errors) -> Any:
        asked = []

        def examine(problem: Problem, split: int) -> Any:
            asked.append(problem)
            fit = Fit((float(len(problem.effects)),), (1.0,), float(len(problem.effects)), 0.5)
            finding = Finding("line", f"{len(problem.effects)} carried", 1.0, 9.0)
            return SimpleNamespace(
                fitted=fit, held_out=replace(fit, whiteness_p=0.1), findings=(finding,), residual=len(problem.effects)
            )

        def claimed(part: Problem, found: SimulationTrace, later: Record) -> Claim:
            assert (len(part.record), len(later)) == (SPLIT, N - SPLIT)
            return Claim(errors, {name: {"c": Estimate(2.0, 1.0, 3.0)} for name in found.effects})

        def by_simulation(part: Problem, skip: int, progress: Any) -> SimulationTrace:
            assert (len(part.record), skip) == (SPLIT, 50)
            return trace

        monkeypatch.setattr(free_run, "trace_by_simulation", by_simulation)
        monkeypatch.setattr(free_run, "examine", examine)
        monkeypatch.setattr(free_run, "claimed", claimed)
        monkeypatch.setattr(free_run, "undetermined", lambda fit: ("undetermined",))
        problem = Problem(record(), DEVICE, replace(SETTINGS, initial={"kxx": 1.0, "vx": 2.0}))
        return free_run.trace_free_run(problem, split=SPLIT, progress=lambda *what: None), asked

    return run


EXPLAINED = Errors(5e-3, 1e-4, 1e-4, 1e4)


def test_an_effect_is_told_with_interval_and_evidence_and_its_look_alikes(answered: Any) -> None:
    said, asked = answered(found("cubic_stiffness"), EXPLAINED)
    assert (said.verdict, said.share, said.split) == (Verdict.EXPLAINED, 1.0, SPLIT)
    (effect,) = said.effects
    assert (effect.name, effect.evidence) == ("cubic_stiffness", 900.0)
    k3 = effect.coefficients["k3x"]
    assert (k3.value, k3.low, k3.unit) == (7e5, pytest.approx(7e5 * (1 - 0.01 * Z)), "1/(m²·s²)")
    assert said.separations == (Separation("cubic_stiffness", "cubic_isotropic", 0.999, None, None),)
    assert [one.name for one in said.rejected] == ["drag"]
    assert said.undetermined == ("undetermined",)
    assert said.reasons == (
        "a free run of the part held out is 0.0001 V rms off, was 0.005 V; the declared noise is 0.0001 V",
    )
    # The bench's observer begins with the constants of the free run, and what is declared of the rest stays.
    without, carrying = asked
    assert (without.effects, carrying.effects) == ({}, {"cubic_stiffness": {"k3x": 7e5}})
    assert (without.settings.initial["kxx"], carrying.settings.initial["kxx"]) == (2.1e5, 1.92e5)
    assert carrying.settings.initial["vx"] == 2.0
    assert "k3x" not in carrying.settings.initial
    assert (said.before.ratio, said.after.ratio, said.residual_after) == (0.0, 1.0, 1)
    assert said.held_out_after.whiteness_p == 0.1
    assert (said.before.simulation_rmse, said.after.simulation_rmse) == (pytest.approx(2e-4), pytest.approx(2e-4))
    assert (said.held_out_before.simulation_rmse, said.held_out_after.simulation_rmse) == (5e-3, 1e-4)
    assert said.left == ()
    assert [one.text for one in said.findings] == ["0 carried"]


def test_of_a_part_it_is_said_what_it_acts_like_and_what_is_left(answered: Any) -> None:
    said, _ = answered(found("cubic_stiffness"), Errors(5e-3, 1e-3, 1e-4, 1e4))
    assert said.verdict is Verdict.PARTLY
    assert said.reasons[0].startswith("something acts like cubic stiffness: 96.0% of the power above the noise goes; ")
    assert "10 × the noise floor" in said.reasons[1]
    assert [one.text for one in said.left] == ["1 carried"]


@pytest.mark.parametrize(("left", "verdict"), [(1.3, Verdict.UNEXPLAINED), (1.15, Verdict.EXPLAINED)])
def test_what_makes_an_observer_worse_explains_nothing(
    answered: Any, monkeypatch: pytest.MonkeyPatch, left: float, verdict: Verdict
) -> None:
    """By the two that were examined, before and after, on as many samples as were held out."""

    def residual_of(before: Fit, after: Fit, samples: float) -> Errors:
        assert (before.ratio, after.ratio, samples) == (0.0, 1.0, N - SPLIT)
        return Errors(1.2, left, 1.0, samples)

    monkeypatch.setattr(free_run, "residual_of", residual_of)
    said, _ = answered(found("cubic_stiffness"), EXPLAINED)
    assert said.verdict is verdict
    told = (
        "with cubic stiffness, which is not named: an observer that carries it leaves more of the part held out: 1.3 × "
        "the noise floor, was 1.2"
    )
    assert (told in said.reasons) is (verdict is Verdict.UNEXPLAINED)


def test_where_nothing_is_named_its_gain_is_told(answered: Any) -> None:
    said, _ = answered(found("cubic_stiffness"), Errors(5e-3, 4.9e-3, 1e-4, 1e4))
    assert (said.verdict, said.effects, said.share, said.separations) == (Verdict.UNEXPLAINED, (), None, ())
    first = said.rejected[0]
    assert first.name == "cubic_stiffness"
    assert first.reason == "carried, it gains 900 in twice the log-likelihood and leaves the rest"
    assert said.reasons[0] == "a free run of the part held out is 0.005 V rms off; the declared noise is 0.0001 V"
    assert all(one.startswith("with cubic stiffness, which is not named: ") for one in said.reasons[1:])
    assert (said.after, said.held_out_after) == (said.before, said.held_out_before)


def test_one_part_that_is_predicted_does_not_make_up_for_one_that_is_not() -> None:
    """As of a record whose time is rounded: 19 LSB off where it is held out, 80 where it was fitted, 17 of noise."""
    claim = Claim(Errors(19.2, 19.2, 17.0, 1e4), {})
    assert judged(claim, 25.0) == (Verdict.ADEQUATE, ())
    assert judged(claim, 80.0) == (
        Verdict.UNEXPLAINED, ("a free run of the part that was fitted is 4.71 × the declared noise off",)
    )  # fmt: skip


def test_what_lacks_nothing_is_examined_once(answered: Any) -> None:
    nothing = (Account("nothing", 0.0), Account("drag", 5.0))
    said, asked = answered(replace(found(), accounts={None: nothing}), Errors(1e-4, 1e-4, 1e-4, 1e4))
    assert (said.verdict, len(asked), said.share) == (Verdict.ADEQUATE, 1, None)
    assert said.after == said.before
    assert [one.effect for one in said.probabilities] == [None]


GYRO = Device(
    sample_rate=4000.0, stiffness=(1.6e6, 1.62e6, 0.0), damping=(1.0, 1.2, 0.0), amplitude=1e-4,
    sense_gain=(-890.0, 900.0), noise=(1e-4, 1e-4),
)  # fmt: skip


@pytest.mark.parametrize(
    ("named", "driven", "mass"),
    [
        (("nonreciprocal_stiffness",), 0.0, 1.5),  # the coupling of one axis over that of the other
        (("sense_gain",), 0.0, 1.21),  # the square of the gain, or its inverse
        (("nonreciprocal_stiffness", "sense_gain"), 0.0, 1.5),
        (("nonreciprocal_stiffness",), 1.0, None),
        (("drag",), 0.0, None),
    ],
)
def test_masses_are_told_where_nothing_drives(named: tuple[str, ...], driven: float, mass: float | None) -> None:
    """kxy + kn and kxy − kn are one coupling over two masses; a sense gain of 1 + g over √m."""
    drive = np.zeros((9, 2, 1))
    drive[7, 1] = driven  # a single sample of one axis
    record = Record(np.zeros((9, 2)), drive, np.full(9, 1 / 4000.0))
    values = {"kxy": 5.0, "kn": 1.0, "gy": 0.1}
    trace: Any = SimpleNamespace(after=SimpleNamespace(value=values.__getitem__))
    said = free_run._unequal_masses(Problem(record, GYRO, ObserverSettings()), trace, named)
    assert len(said) == (mass is not None)
    for one in said:
        assert (one.effect, one.other, one.correlation, one.expected) == (named[0], "unequal_masses", 1.0, None)
        size = float(str(one.separate_by).rpartition("m = ")[2].split()[0].rstrip(",;"))
        assert 1.0 + size == pytest.approx(mass, rel=0.01) or 1.0 / (1.0 + size) == pytest.approx(mass, rel=0.01)


@pytest.mark.parametrize(
    ("before", "after", "effects", "verdict"),
    [
        (THRESHOLDS.free_runs.adequate, 0.0, (), Verdict.ADEQUATE),
        (np.nextafter(THRESHOLDS.free_runs.adequate, 99.0), 0.0, (), Verdict.UNEXPLAINED),
        (9.0, 1.05, ("drag",), Verdict.EXPLAINED),
        (1.0, 1.05, ("drag",), Verdict.UNEXPLAINED),  # at the floor, and was before
        (9.0, 2.0, ("drag",), Verdict.PARTLY),
        (9.0, 8.0, ("drag",), Verdict.UNEXPLAINED),
    ],
)
def test_by_its_error_alone_a_model_is_judged_as_by_a_claim(
    before: float, after: float, effects: tuple[str, ...], verdict: Verdict
) -> None:
    """In whatever unit."""
    assert free_run.verdict_of(before * 2.0**-10, after * 2.0**-10, 2.0**-10, effects) is verdict


@pytest.mark.moderate
def test_what_is_shown_of_the_rest_is_its_beginning_without_and_with_the_effects() -> None:
    """In V, from the first sample on; where the start is set there is nothing."""
    bare, carrying, later = Observer(DEVICE, ObserverSettings()), Observer(DEVICE, CARRYING), record()
    models: Any = SimpleNamespace(
        observer_before=bare, before=refined(bare, kxx=2.1e5, dxx=40.0, phi_x=0.0),
        observer=carrying, after=refined(carrying, **TRUE),
    )  # fmt: skip
    before, after = free_run._shown(models, later)
    shown = min(len(later), THRESHOLDS.free_runs.scored_from + 2000)
    assert len(before) == len(after) == shown
    assert np.nanmax(np.abs(after)) < 1e-6 < np.nanmax(np.abs(before))
    assert np.all(np.isnan(after[: THRESHOLDS.free_runs.scored_from]))
    assert np.all(np.isfinite(after[THRESHOLDS.free_runs.scored_from :]))
