"""Look-alikes by likelihood: what comes within odds of 20 to 1 of the effect that was taken, once both are carried."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from estimator.trace import observer_model
from estimator.trace.engine import Score, Step, Trial
from estimator.trace.fitting import deficit, leads
from estimator.trace.probability import NOTHING
from estimator.trace.rivals import accounts, dispersion, in_the_end, left_out, rivals, simpler_rival
from estimator.trace.scan import PARTS
from estimator.trace.searched import Searched

N = 32_000
PROBLEM = SimpleNamespace(device=SimpleNamespace(axes=2, own=()))
TIE = 2.0 * math.log(20.0)


def fitted(innovation, deviation=1.0, effects=None):
    estimates = SimpleNamespace(innovation=innovation, innovation_deviation=np.full_like(innovation, deviation))
    return SimpleNamespace(
        estimates=estimates,
        settings=SimpleNamespace(effects=effects or {}),
        observer=SimpleNamespace(device=SimpleNamespace(axes=2, own=())),
    )


def noise(seed: int, colour: float = 0.0):
    """Of unit power; colour: correlation from sample to sample."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((N, 2))
    for k in range(1, N if colour else 1):
        white[k] = colour * white[k - 1] + math.sqrt(1.0 - colour**2) * white[k]
    return white


def apart(series, lead: float, where=slice(None)):
    """The innovations of a model that is behind by `lead` in twice the log-likelihood, there."""
    slow = np.zeros_like(series)
    at = np.arange(N)[where]
    slow[where, 0] = 1.0 + 0.5 * np.sin(at / 900.0)
    slow[where] -= series[where] * np.sum(slow * series) / np.sum(series[where] ** 2)  # so that no chance is in it
    return series + slow * math.sqrt(lead / np.sum(slow**2))


def step(lead: float, *, price=0.0, other="sense_gain", series=None, where=slice(None), searched=None):
    own = noise(1) if series is None else series
    given = {"parasitic_mode:1": {}, "base_vibration:2": {"omega": 7.0}, "sense_gain": {}, "drive_gain:1": {}}
    given["dry_friction:1"] = {"v0": 4.0}
    models = fitted(own, effects={"drive_gain": {}}), fitted(apart(own, lead, where), effects=given)
    scores = Score(1000.0, 500.0, 10.0, 20.0), Score(1000.0 - lead, 500.0 - lead, 10.0 + price, 20.0)
    problem = SimpleNamespace(device=SimpleNamespace(axes=2, own=()))
    trials = [
        Trial(SimpleNamespace(fitted=model, problem=problem, searched=searched or {}), score)
        for model, score in zip(models, scores, strict=True)
    ]
    return Step("drive_gain", trials[0], None, {other: trials[1]})


def test_the_lead_is_the_difference_of_the_likelihoods() -> None:
    one, two = noise(2), noise(3)
    sd, other = 1.3, 0.7
    direct = [-np.sum((v / s) ** 2 + 2.0 * np.log(s)) for v, s in ((one, sd), (two, other))]
    parts = leads(fitted(one, sd), fitted(two, other))
    assert parts.shape == (PARTS,)
    assert float(np.sum(parts)) == pytest.approx(direct[0] - direct[1])


@pytest.mark.parametrize(
    ("lead", "listed"), [(0.5 * TIE, True), (0.95 * TIE, True), (1.6 * TIE, False), (500.0, False)]
)
def test_what_comes_within_odds_of_twenty_is_a_look_alike(lead: float, listed: bool) -> None:
    found = rivals(step(lead))
    assert set(found) == ({"sense_gain"} if listed else set())
    if listed:
        assert found["sense_gain"].deficit == pytest.approx(lead, abs=0.5 * TIE)


@pytest.mark.parametrize("colour", [0.0, 0.8])
@pytest.mark.parametrize(("lead", "found"), [(0.9 * TIE, "sense_delay"), (1.6 * TIE, None)])
def test_what_a_low_pass_is_not_told_from_is_a_delay(lead: float, found: str | None, colour: float) -> None:
    """Where innovations are not white either: something is missing there, and the better one is not turned down."""
    own = noise(1, colour)
    trials = {
        name: Trial(
            SimpleNamespace(fitted=fitted(innovation, effects={name: {}}), problem=PROBLEM, searched={}),
            Score(0.0, 500.0, 10.0, 20.0),
        )
        for name, innovation in (("sense_low_pass", own), ("sense_delay", apart(own, lead)))
    }
    assert simpler_rival("sense_low_pass", trials) == found
    assert simpler_rival("sense_delay", trials) is None
    assert simpler_rival("sense_low_pass", {"sense_low_pass": trials["sense_low_pass"]}) is None


def test_the_price_counts() -> None:
    assert rivals(step(0.5 * TIE, price=2.0 * TIE)) == {}
    assert set(rivals(step(3.0 * TIE, price=-2.5 * TIE))) == {"sense_gain"}


@pytest.mark.parametrize(("calm", "listed"), [(True, True), (False, False)])
def test_numbers_that_the_record_says_nothing_of_are_not_paid_for(monkeypatch, calm: bool, listed: bool) -> None:
    """A mode has two coefficients, its frequency and its damping: these two where the drive has one frequency."""
    monkeypatch.setattr(observer_model, "of_resonance_alone", lambda record, device: calm)
    mode = step(0.5 * TIE, price=10.0, other="parasitic_mode:1")  # twice 10, of a feedthrough's two numbers
    mode.trial.fit.problem.record = None
    found = rivals(mode)
    assert bool(found) is listed
    if calm:  # two numbers paid for, as of the feedthrough
        assert found["parasitic_mode:1"].deficit == pytest.approx(0.5 * TIE, abs=0.25 * TIE)


@pytest.mark.parametrize(
    ("deviation", "paid"),
    [(None, 5.0), (0.0, 0.0), (4.0, math.log(2.0)), (2.0, math.log(5.0)), (0.4, math.log(101.0)), (1e-9, 5.0)],
)
def test_a_parameter_costs_what_its_search_was_told(deviation: float | None, paid: float) -> None:
    """Dry friction has two coefficients and a velocity, 4.0: another two numbers cost 10, three of them 15."""
    searched = (
        {} if deviation is None else {"dry_friction:1": Searched(("v0",), np.diag([deviation**2]), np.zeros((2, 1)))}
    )
    found = rivals(step(1e-6, price=5.0, other="dry_friction:1", searched=searched))
    assert found["dry_friction:1"].deficit == pytest.approx(paid, abs=1e-3)


def test_another_of_the_same_kind_is_none_and_parameters_are_kept() -> None:
    assert rivals(step(1.0, other="drive_gain:1")) == {}
    assert rivals(step(1.0, other="base_vibration:2"))["base_vibration:2"].parameters == {"omega": 7.0}


def test_what_the_start_alone_tells_does_not_count() -> None:
    begin, later = slice(0, N // PARTS), slice(N // 2, N // 2 + N // PARTS)
    assert set(rivals(step(300.0, where=begin))) == {"sense_gain"}
    assert rivals(step(300.0, where=later)) == {}


@pytest.mark.moderate
def test_innovations_that_are_not_white_make_the_bound_wider() -> None:
    # Noise of correlation r is (1 + r)/(1 − r) times as strong where it is slow, and so is what it makes of a lead.
    def mean(colour: float) -> float:
        spread = []
        for seed in range(4, 10):
            own = noise(seed, colour)
            spread.append(dispersion(fitted(own), fitted(own + 0.01 * np.sin(np.arange(N) / 900.0)[:, None])))
        return float(np.mean(spread))

    assert mean(0.0) == pytest.approx(1.0, rel=0.35)
    assert mean(0.8) == pytest.approx(9.0, rel=0.35)
    assert set(rivals(step(3.0 * TIE, series=noise(20, 0.8)))) == {"sense_gain"}


def test_what_the_start_of_a_pass_makes_is_no_noise_of_the_rest() -> None:
    """Two passes that begin otherwise part in the first cycles, by what the likelier one follows there: in one of the
    records of a campaign by 47, beside 3 of noise in all that was left.
    """
    own, first = noise(1), slice(0, N // PARTS)
    begun = apart(own, 40.0)
    begun[first] -= 0.3 * own[first]
    assert dispersion(fitted(own), fitted(begun)) == pytest.approx(dispersion(fitted(own), fitted(apart(own, 40.0))))
    later = apart(own, 40.0)
    later[N // PARTS : 2 * N // PARTS] -= 0.3 * own[N // PARTS : 2 * N // PARTS]
    assert dispersion(fitted(own), fitted(later)) > 100.0


def test_equal_models_do_not_divide_by_nothing() -> None:
    own = noise(1)
    assert dispersion(fitted(own), fitted(own.copy())) == 1.0


def look(**gains):
    """Of these candidates, each with a gain and a scatter."""
    evidence = {name: SimpleNamespace(name=name, gain=gain, scatter=scatter) for name, (gain, scatter) in gains.items()}
    device = SimpleNamespace(axes=2, own=())
    seen = SimpleNamespace(innovation=np.zeros((N, 2)), observer=SimpleNamespace(device=device))
    return SimpleNamespace(evidence=evidence, seen=seen)


def test_all_that_was_asked_has_its_account() -> None:
    """By likelihood what was carried, by the scan what was not, each with its price; gains of 500, prices of 10."""
    lead, own = 40.0, noise(1)
    without = fitted(apart(own, 500.0))
    models = step(lead, price=3.0, series=own)
    asked = Step(models.name, models.trial, SimpleNamespace(fitted=without), models.beside)
    watched = look(sense_gain=(499.0, 1.0), cubic_stiffness=(600.0, 3.0), drive_gain=(600.0, 1.0))
    found = {one.name: one.deficit for one in accounts(asked, watched)}
    assert set(found) == {"drive_gain", "sense_gain", "cubic_stiffness", NOTHING}
    assert found["drive_gain"] == 0.0
    assert found["sense_gain"] == pytest.approx(lead + 3.0, abs=0.05 * lead)
    assert found[NOTHING] == pytest.approx(deficit(models.trial.fit.fitted, without) - 10.0)
    price = 2.0 * math.log(2 * N)
    assert found["cubic_stiffness"] == pytest.approx((500.0 - 10.0) - (600.0 / 3.0 - price))


def test_where_nothing_was_taken_all_stand_beside_nothing() -> None:
    found = {one.name: one.deficit for one in left_out(look(sense_gain=(5.0, 0.5), drive_gain=(30.0, 2.0)))}
    assert found[NOTHING] == 0.0
    assert found["sense_gain"] == pytest.approx(math.log(2 * N) - 5.0)  # one coefficient
    assert found["drive_gain"] == pytest.approx(2.0 * math.log(2 * N) - 15.0)


def test_nothing_stands_as_it_does_beside_all_that_was_taken() -> None:
    """A stranger's record with two lines: beside the first alone the record was unsure whether that was needed, and the
    answer said nothing with 98 %, of a line that gained 13,688 in the end."""
    white = noise(21)
    missing = white + 3.0 * np.sin(np.arange(N) / 700.0)[:, None]
    price = 12.0
    problem = SimpleNamespace(device=SimpleNamespace(axes=2, own=()))
    carried = SimpleNamespace(fitted=fitted(missing, effects={"drive_gain": {}}), problem=problem, searched={})
    before = SimpleNamespace(fitted=fitted(apart(missing, 300.0)))
    asked = Step("drive_gain", Trial(carried, Score(1000.0, 300.0, price, 20.0)), before, {})
    watched = SimpleNamespace(seen=SimpleNamespace(innovation=white), evidence={})
    then = accounts(asked, watched)
    less = SimpleNamespace(fitted=fitted(apart(white, 300.0)))
    last = SimpleNamespace(fitted=fitted(white), less={"drive_gain": (less, None)})
    unsure, sure = ({one.name: one for one in found}[NOTHING] for found in (then, in_the_end(then, asked, last)))
    assert unsure.dispersion > 10.0
    assert unsure.weight > 1e-6
    assert sure.dispersion < 2.0
    assert sure.deficit == pytest.approx(deficit(last.fitted, less.fitted) - (unsure_price := _price_of(asked, unsure)))
    assert unsure_price > 0.0
    assert sure.weight < 1e-30
    assert [one for one in in_the_end(then, asked, last) if one.name != NOTHING] == [
        one for one in then if one.name != NOTHING
    ]
    assert in_the_end(then, asked, SimpleNamespace(fitted=last.fitted, less={})) == then


def _price_of(asked: Step, nothing) -> float:
    """What nothing is spared, by what it is behind."""
    return deficit(asked.trial.fit.fitted, asked.before.fitted) - nothing.deficit
