"""Models by their free run, piece by piece: promises beside regression written out, rows, starts, who is hopeful."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator import free_stretches
from estimator.errors import ModelError
from estimator.identification.problem import Problem
from estimator.observer import Observer
from estimator.record import Record
from estimator.refinement import Refined
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings
from estimator.trace import free_run_model
from estimator.trace.criterion import extended
from estimator.trace.engine import Score, Trial
from estimator.trace.free_run_model import FreeRun, FreeRunModel, Promise, parts_of, promises_of

RATE, N = 600.0, 400
DEVICE = Device(sample_rate=RATE, stiffness=(1.9e5,), damping=(40.0,), amplitude=0.1, sense_gain=(2.0,), noise=(1e-4,))
SETTINGS = ObserverSettings(memory=0.5)
NAMES = ("x", "vx", "kxx", "k3x", "dqx", "fx", "gone")


def record(samples: int = N, *, driven: bool = True) -> Record:
    drive = np.random.default_rng(3).standard_normal((samples, 1, 1)) if driven else np.zeros((samples, 1, 1))
    return Record(np.zeros((samples, 1)), drive, np.full(samples, 1.0 / RATE))


def found(free: tuple[str, ...], residual: Array, **values: float) -> Refined:
    state = np.array([values.get(name, 0.0) for name in NAMES])
    return Refined(NAMES, free, state, 0.1 * np.ones(len(NAMES)), residual, np.zeros(1))


def effect(name: str, *symbols: str) -> tuple[int, Any]:
    return 0, SimpleNamespace(
        name=name,
        gain=name == "friction",
        coefficients=[SimpleNamespace(name=symbol, positive=symbol == "fx", is_shape=False) for symbol in symbols],
    )


EFFECTS = [effect("cubic", "k3x", "gone"), effect("drag", "dqx"), effect("friction", "fx")]


# -- what is promised -------------------------------------------------------------------------------------------------


class Played:
    """In the place of a free run: a residual and derivatives that are drawn."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, samples: int = N) -> None:
        rng = np.random.default_rng(4)
        self.sensitivity = rng.standard_normal((samples, 1, len(NAMES)))
        self.sensitivity[:, :, 2] *= 1e9  # a constant of another size
        self.sensitivity[:, :, 3] = self.sensitivity[:, :, 0] + 0.5 * self.sensitivity[:, :, 3]
        self.sensitivity[:, :, 5] = self.sensitivity[:, :, 1] + 0.02 * self.sensitivity[:, :, 5]  # hardly its own
        self.sensitivity[:, :, 6] = 0.0
        self.sensed = rng.standard_normal((samples, 1)) + 0.3 * self.sensitivity[:, :, 4]
        self.asked: dict[str, Any] = {}

        def observer(problem: Problem, effects: tuple[str, ...]) -> Any:
            self.asked["effects"] = effects
            return SimpleNamespace(names=NAMES, effects=EFFECTS, state=np.zeros(len(NAMES)))

        def simulate(observer: Any, state: Array, drive: Array, *, step: Array, sensitive: bool) -> Any:
            self.asked |= {"state": state, "samples": len(drive), "sensitive": sensitive}
            return SimpleNamespace(sensed=self.sensed, sensitivity=self.sensitivity)

        monkeypatch.setattr(free_run_model, "_observer", observer)
        monkeypatch.setattr(free_stretches, "simulate", simulate)
        monkeypatch.setattr(free_run_model, "effective_samples", lambda residual: 77.0 + len(residual) % 2)


@pytest.mark.parametrize("lost", [0, 31])
def test_a_promise_is_what_regression_beside_all_that_is_fitted_would_explain(
    monkeypatch: pytest.MonkeyPatch, lost: int
) -> None:
    played = Played(monkeypatch)
    seen = record()
    seen.sense[:] = np.random.default_rng(9).standard_normal(seen.sense.shape)
    seen.sense[100 : 100 + lost] = np.nan
    rows = slice(50, 300)
    current = found(("x", "vx", "kxx"), np.zeros((N, 1)), x=0.25, kxx=7.0, dqx=3.0)
    said = promises_of(Problem(seen, DEVICE, SETTINGS), ("taken",), ("cubic", "drag", "friction"), current, rows)
    assert played.asked["effects"] == ("taken", "cubic", "drag", "friction")
    assert played.asked["sensitive"] is True
    np.testing.assert_array_equal(played.asked["state"], [0.25, 0.0, 7.0, 0.0, 3.0, 0.0, 0.0])
    use = np.isfinite(seen.sense[rows, 0])
    error = (seen.sense[rows] - played.sensed[rows])[use, 0]
    columns = played.sensitivity[rows][use, 0] / np.array([1, 1, 1e9, 1, 1, 1, 1])
    samples = 77.0 + len(error) % 2

    def left(*at: int) -> float:
        basis = columns[:, list(at)]
        return float(np.sum((error - basis @ np.linalg.lstsq(basis, error, rcond=None)[0]) ** 2))

    for name, at in (("cubic", 3), ("drag", 4)):
        expected = samples * math.log(left(0, 1, 2) / left(0, 1, 2, at))
        assert said[name].gain == pytest.approx(expected, rel=1e-9)
        assert said[name].signature.shape == (len(error), 1)
        np.testing.assert_allclose(columns[:, :3].T @ said[name].signature, 0.0, atol=1e-9)
    assert said["drag"].price == extended(1, samples, 3)
    assert said["cubic"].price == extended(2, samples, 3)  # both of its coefficients, though one shows nothing
    # 2 % of a signature is less than must be left of it: it explains nothing.
    assert (said["friction"].gain, said["friction"].price) == (0.0, extended(1, samples, 3))
    assert said["friction"].signature.shape[1] == 0


def test_what_is_known_to_show_is_asked_however_little_of_it_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    Played(monkeypatch)
    current = found(("x", "vx", "kxx"), np.zeros((N, 1)))
    problem = Problem(record(), DEVICE, SETTINGS)
    said = promises_of(problem, (), ("drag", "friction"), current, slice(0, N), shown="friction")
    assert said["friction"].signature.shape[1] == 1
    assert said["friction"].gain > 0.0


def test_what_is_fitted_and_shows_nothing_takes_nothing_away(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch)
    played.sensitivity[:, :, 1] = 0.0
    problem = Problem(record(), DEVICE, SETTINGS)
    with_it, without = (
        promises_of(problem, (), ("drag",), found(free, np.zeros((N, 1))), slice(0, N))
        for free in (("x", "vx", "kxx"), ("x", "kxx"))
    )
    assert with_it["drag"].gain == pytest.approx(without["drag"].gain)


def test_what_would_explain_everything_promises_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch)
    played.sensed = -2.0 * played.sensitivity[:, :, 4]
    current = found(("x",), np.zeros((N, 1)))
    said = promises_of(Problem(record(), DEVICE, SETTINGS), (), ("drag",), current, slice(0, N))
    assert said["drag"].gain == pytest.approx(77.0 * math.log(1e12), rel=1e-3)


# -- the model --------------------------------------------------------------------------------------------------------


def model(**given: Any) -> FreeRunModel:
    problem = Problem(record(), DEVICE, SETTINGS)
    return FreeRunModel(problem, slice(0, 300), slice(300, N), ("cubic", "drag", "friction", "line"), **given)


def run_of(residual: Array, *effects: str) -> FreeRun:
    return FreeRun(effects, SimpleNamespace(effects=EFFECTS), found(("x",), residual))  # type: ignore[arg-type]


def test_candidates_are_asked_that_are_neither_carried_nor_barred(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(free_run_model, "promises_of", lambda *given: asked.append(given))
    current = run_of(np.zeros((N, 1)), "drag", "given")
    model().promise(current, ("line",))
    ((_, taken, left, fit, rows),) = asked
    assert (taken, left, fit, rows) == (("drag", "given"), ["cubic", "friction"], current.fit, slice(0, 300))


def test_hopeful_are_the_three_whose_promise_outweighs_its_price_most() -> None:
    worth = {"a": (9.0, 8.0), "b": (30.0, 10.0), "c": (7.0, 8.0), "d": (20.0, 19.5), "e": (12.0, 3.0), "f": (5.0, 5.0)}
    look = {name: Promise(gain, price, np.zeros((0, 0))) for name, (gain, price) in worth.items()}
    assert list(model().hopeful(look, {}, (), 0)) == ["b", "e", "a"]


@pytest.mark.parametrize(
    ("there", "asked"),
    [
        (("quintic_stiffness", "cubic_stiffness", "drag"), ["cubic_stiffness", "drag"]),
        (("quintic_stiffness", "drag"), ["quintic_stiffness", "drag"]),  # the first is carried, or barred
        (("drive_saturation", "drive_gain"), ["drive_saturation", "drive_gain"]),  # no terms of one law
    ],
)
def test_the_next_term_of_a_law_waits_for_the_first(there: tuple[str, ...], asked: list[str]) -> None:
    """Of a beam 704 for the fifth order and 679 for the third: with the fifth first, twice the residual was left."""
    look = {name: SimpleNamespace(gain=704.0 - 25.0 * place, price=10.0) for place, name in enumerate(there)}
    assert list(model().hopeful(look, {}, (), 0)) == asked


def test_each_is_fitted_beside_what_is_carried_from_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    current = run_of(np.zeros((N, 1)), "drag")

    def fitted(problem: Problem, effects: tuple[str, ...], start: Refined, rows: slice) -> Any:
        assert (start, rows) == (current.fit, slice(0, 300))
        if effects[-1] == "line":
            raise ModelError("out of bounds")
        return effects

    monkeypatch.setattr(free_run_model, "fitted", fitted)
    told: list[tuple[str, int, int]] = []
    said = replace(model(), progress=lambda *what: told.append(what)).fit(current, {}, ("cubic", "line"), {})
    assert said == {"cubic": ("drag", "cubic"), "line": "no free run with it stays within bounds"}
    assert told == [("candidates", 1, 2), ("candidates", 2, 2)]


def test_a_gain_is_counted_in_independent_samples_of_the_rows_that_choose(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice the logarithm of the ratio of two rms, for each of them; lost samples say nothing."""
    monkeypatch.setattr(free_run_model, "effective_samples", lambda residual: float(len(residual)) / 2.0)
    before, after = np.full((N, 1), 3.0), np.full((N, 1), 2.0)
    before[300:], after[300:] = 1.0, 99.0  # not of the rows that choose
    before[7], after[7] = np.nan, np.nan
    look = {"drag": Promise(1.0, 4.5, np.zeros((0, 0)))}
    (score,) = model().score(run_of(before), look, {"drag": run_of(after, "drag")}).values()
    gain = 299.0 / 2.0 * 2.0 * math.log(3.0 / 2.0)
    assert score == Score(pytest.approx(gain), pytest.approx(gain), 4.5, 4.5)


@pytest.mark.parametrize(("later", "objects"), [(0.9, False), (1.0, True), (1.1, True)])
def test_the_third_without_a_vote_must_be_predicted_better(later: float, *, objects: bool) -> None:
    before, after = np.ones((N, 1)), np.full((N, 1), 0.1)
    after[300:] = later
    after[301] = np.nan
    trial = Trial(run_of(after, "drag"), Score(1.0, 1.0, 0.0, 0.0))
    said = model().objection(run_of(before), "drag", trial)
    assert said == ("fits two thirds of the record better and the other third worse" if objects else None)


def test_coefficients_are_told_with_their_intervals() -> None:
    fit = run_of(np.zeros((N, 1)), "drag")
    fit = replace(fit, fit=found(("dqx",), np.zeros((N, 1)), dqx=2.0, fx=-1.0))
    said = model().coefficients(fit)
    assert set(said) == {"cubic", "drag", "friction"}
    drag = said["drag"]["dqx"]
    assert (drag.value, drag.low, drag.high) == pytest.approx((2.0, 2.0 - 0.196, 2.0 + 0.196), abs=1e-4)
    assert [said[name][symbol].positive for name, symbol in (("drag", "dqx"), ("friction", "fx"))] == [False, True]
    assert [said[name][symbol].gain for name, symbol in (("drag", "dqx"), ("friction", "fx"))] == [False, True]


# -- rows and starts --------------------------------------------------------------------------------------------------


def test_of_a_driven_record_the_last_third_agrees_and_of_a_free_one_every_third_block_of_sixteen() -> None:
    assert parts_of(record(90), 5) == (slice(5, 60), slice(60, 90))
    chooses, agrees = parts_of(record(100, driven=False), 5)
    assert isinstance(agrees, np.ndarray)
    expected = [k for k in range(100) if (k // 16) % 3 == 2]
    assert np.flatnonzero(agrees).tolist() == expected
    np.testing.assert_array_equal(chooses, ~agrees)


class Refines:
    """In the place of a refinement: what it was asked, and a state that grows by one each time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[dict[str, Any]] = []
        monkeypatch.setattr(free_run_model, "refine", self)

    def __call__(self, observer: Observer, sense: Array, drive: Array, **given: Any) -> Any:
        assert len(sense) == len(drive) == len(given["step"])
        self.asked.append({"samples": len(sense), "state": given["start"].copy(), **given})
        return SimpleNamespace(state=given["start"] + 1.0)


def test_a_driven_run_is_fitted_from_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    refines = Refines(monkeypatch)
    current = found(("x",), np.zeros((N, 1)), x=0.5, kxx=1.7e5, k3x=9.0)
    problem = Problem(record(), DEVICE, replace(SETTINGS, gain=Gain.STATIONARY))
    rows = slice(3, 9)
    fit = free_run_model.fitted(problem, ("cubic_stiffness",), current, rows)
    (asked,) = refines.asked
    names = fit.observer.names
    state = dict(zip(names, asked["state"], strict=True))
    assert (state["x"], state["kxx"], state["k3x"]) == (0.5, 1.7e5, 9.0)
    assert state["dxx"] == Observer(DEVICE, SETTINGS).state[Observer(DEVICE, SETTINGS).names.index("dxx")]
    assert asked["rows"] == rows
    assert set(asked["known"]) >= {"kxx", "dxx"}
    assert fit.effects == ("cubic_stiffness",)
    assert fit.observer.settings.gain is Gain.EKF
    assert free_run_model.coefficient_names(problem, "cubic_stiffness") == {"k3x"}


@pytest.mark.parametrize("afresh", [True, False])
def test_a_free_run_is_fitted_to_ever_longer_beginnings(monkeypatch: pytest.MonkeyPatch, *, afresh: bool) -> None:
    """64, 192, 576, …; afresh the motion alone of the first, with the constants of one pass of the observer."""
    refines = Refines(monkeypatch)
    passes: list[int] = []

    def run(self: Observer, sense: Array, drive: Array, *, step: Array) -> None:
        passes.append(len(sense))
        self.x[self.states :] = 0.5

    monkeypatch.setattr(Observer, "run", run)
    problem = Problem(record(700, driven=False), DEVICE, SETTINGS)
    current = None if afresh else found(("x",), np.zeros((700, 1)), x=0.5, vx=2.0, kxx=1.7e5)
    free_run_model.fitted(problem, (), current, slice(0, 700))
    lengths = [asked["samples"] for asked in refines.asked]
    assert lengths == ([64] if afresh else []) + [64, 192, 576, 700]
    first = refines.asked[0]
    scratch = Observer(DEVICE, SETTINGS)
    declared = scratch.state.copy()
    if afresh:
        assert passes == [700]
        assert first["free"] == ("x", "vx")
        assert "runs" not in first
        scratch.x[2:] = 0.5
        np.testing.assert_allclose(first["state"], [*declared[:2], *scratch.state[2:]])
    else:
        assert passes == []
        np.testing.assert_allclose(first["state"][:3], [0.5, 2.0, declared[2]])
        assert first["state"][scratch.names.index("kxx")] == 1.7e5
    for one, other in zip(refines.asked, refines.asked[1:], strict=False):  # each begins where the last one ended
        np.testing.assert_allclose(other["state"], one["state"] + 1.0)
    assert [asked.get("runs") for asked in refines.asked[-4:]] == [12, 12, 12, None]
    assert all(asked["free"] == scratch.estimated for asked in refines.asked[-4:])


def test_a_pass_that_diverged_tells_no_constants(monkeypatch: pytest.MonkeyPatch) -> None:
    refines = Refines(monkeypatch)

    def run(self: Observer, sense: Array, drive: Array, *, step: Array) -> None:
        self.x[3] = np.nan

    monkeypatch.setattr(Observer, "run", run)
    free_run_model.fitted(Problem(record(100, driven=False), DEVICE, SETTINGS), (), None, slice(0, 100))
    np.testing.assert_array_equal(refines.asked[0]["state"], Observer(DEVICE, SETTINGS).state)


def test_a_beginning_is_shorter_than_the_record(monkeypatch: pytest.MonkeyPatch) -> None:
    refines = Refines(monkeypatch)
    current = found(("x",), np.zeros((64, 1)))
    free_run_model.fitted(Problem(record(64, driven=False), DEVICE, SETTINGS), (), current, slice(0, 64))
    assert [asked["samples"] for asked in refines.asked] == [64]


def test_candidates_need_nothing_given_and_are_not_carried() -> None:
    from estimator.effects.catalogue import EFFECTS

    names = free_run_model.candidates(DEVICE, replace(SETTINGS, effects={"drag": {}}))
    assert "drag" not in names
    assert {"cubic_stiffness", "dry_friction", "drive_gain"} <= set(names)
    demanding = {one.name for one in EFFECTS if any(p.default is None for p in one.parameters)}
    assert demanding
    assert not demanding & set(names)
    assert not {one.name for one in EFFECTS if one.declared_only} & set(names)


def test_what_cannot_be_run_freely_is_no_candidate(monkeypatch: pytest.MonkeyPatch) -> None:
    def simulate(observer: Any, state: Array, drive: Array) -> None:
        assert drive.shape == (2, 1)
        if "drag" in observer.settings.effects:
            raise ModelError("no free run")

    monkeypatch.setattr(free_run_model, "simulate", simulate)
    names = free_run_model.candidates(DEVICE, SETTINGS)
    assert "drag" not in names
    assert "cubic_stiffness" in names
