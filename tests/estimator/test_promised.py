"""How a trace keeps its promises (docs/reference/trace.md): what is taken out, what is said in part."""

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from estimator.diagnosis import Fit, Verdict
from estimator.identification.problem import Problem
from estimator.record import Record
from estimator.settings import ObserverSettings
from estimator.trace import claims, free_run
from estimator.trace.engine import Estimate, Outcome, Score, Tried, tried_reason
from estimator.trace.promises import Claim, Constant, Errors
from tests.estimator.device import NOMINAL as DEVICE

SURE, NOTHING = Estimate(0.05, 0.04, 0.06), Estimate(-1.9, -7.0, 3.0)
N, SPLIT = 1000, 600
RECORD = Record(np.zeros((N, 2)), np.zeros((N, 2, 1)), np.full(N, 1 / 4000.0))
PROBLEM = Problem(RECORD, DEVICE, ObserverSettings())


def errors(before, after, gain=100.0):
    return Errors(before, after, 1.0, 1e5, gain=gain)


@dataclass(frozen=True)
class Selected:
    """As much of a selection as a verdict needs."""

    coefficients: dict
    gain: dict
    patchwork: bool = False
    samples: int = 600
    rivals: dict = field(default_factory=dict)
    alike: dict = field(default_factory=dict)
    accounts: dict = field(default_factory=dict)
    rounds: tuple = (SimpleNamespace(look=SimpleNamespace(evidence={})),)

    @property
    def effects(self):
        return {name: {"c": 1.0} for name in self.coefficients}


SURE_OF = {
    "sense_delay": {"tsx": SURE},
    "drive_gain": {"hx": SURE},
    "sense_gain": {"gy": NOTHING},
    "electrostatic_drive": {"qx": SURE},
}
IMPOSSIBLE = {("electrostatic_drive",): (Constant("kxx", -1.0, -1.1, -0.9, 1.0, 0.05, True),)}
DELAYS = {("drive_delay",): errors(1.7, 1.114), ("sense_delay",): errors(1.7, 1.002), (): errors(1.7, 1.7)}


def test_a_free_run_does_not_call_a_series_its_cause_either():
    springs = ("cubic_stiffness", "quadratic_stiffness", "quintic_stiffness")
    claims_of = [Claim(errors(9.0, 1.0), {name: {"c": SURE} for name in names}) for names in (springs, springs[:2])]
    (verdict, against), (of_two, none) = (free_run.judged(claim) for claim in claims_of)
    assert (verdict, len(against)) == (Verdict.PARTLY, 1)
    assert "the force of the spring" in against[0]
    assert (of_two, none) == (Verdict.EXPLAINED, ())


SOFT = Constant("kxx", 46.0, 45.0, 47.0, declared=1191.0, deviation=119.0)


UNSURE = Constant("dyy", 49.5, 26.3, 72.8, declared=22.3, deviation=13.2, positive=True)
FAR = replace(UNSURE, value=103.4, low=79.0, high=127.7)


# -- the claim of two axes -------------------------------------------------------------------------------------------


def test_the_floor_is_the_lower_of_the_two() -> None:
    """A model that raises the whole spectrum of one axis does not raise its own measure."""
    before, after = Fit((1.0, 2.0), (1.0, 1.0), 1.6, 0.0), Fit((4.0, 1.0), (4.0, 1.0), 1.0, 0.5)
    residual = claims.residual_of(before, after, 800.0)
    assert residual.before == pytest.approx(np.sqrt(2.5))
    assert residual.after == pytest.approx(np.sqrt(8.5))
    assert not residual.fell


def examined(rate, angle_error, rate_error, deviation=0.01, angle_deviation=0.002):
    index = np.arange(N)
    names = ("x", "rate")
    state = np.stack([np.zeros(N), rate], axis=1)
    sure = np.full((N, 2), deviation)

    class Seen(SimpleNamespace):
        def of(self, name):
            return self.state[:, self.names.index(name)]

    estimates = Seen(names=names, index=index, state=state, deviation=sure, angle_deviation=np.full(N, angle_deviation))
    fit = Fit((1.0, 1.0), (1.0, 1.0), 1.0, 0.5, angle_error_rms=angle_error, rate_error_rms=rate_error)
    return SimpleNamespace(estimates=estimates, held_out=fit)


# -- free runs -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("claim", "verdict"),
    [
        (Claim(Errors(9.0, 1.05, 1.0, 1e4), {"a": {"c": SURE}}), Verdict.EXPLAINED),
        (Claim(Errors(9.0, 2.0, 1.0, 1e4), {"a": {"c": SURE}}), Verdict.PARTLY),
        (Claim(Errors(9.0, 8.0, 1.0, 1e4), {"a": {"c": SURE}}), Verdict.UNEXPLAINED),
        (Claim(Errors(1.8, 12.0, 1.0, 1e4), {"a": {"c": SURE}}), Verdict.UNEXPLAINED),
        (Claim(Errors(9.0, 1.0, 1.0, 1e4), {"a": {"c": SURE}}, (SOFT,)), Verdict.PARTLY),
        (Claim(Errors(2.0, 2.0, 1.0, 1e4), {}), Verdict.ADEQUATE),
        (Claim(Errors(4.0, 4.0, 1.0, 1e4), {}), Verdict.UNEXPLAINED),
        (Claim(Errors(1.0, 1.0, 1.0, 1e4), {}, (SOFT,)), Verdict.UNEXPLAINED),
    ],
)  # fmt: skip
def test_a_free_run_stands_before_the_same_guards(claim: Claim, verdict: Verdict) -> None:
    assert free_run.judged(claim)[0] is verdict


def test_a_free_run_loses_what_may_be_nothing_and_what_is_minor(monkeypatch: pytest.MonkeyPatch) -> None:
    def less(part, found, names, skip):
        kept = {name: gain for name, gain in found.evidence.items() if name not in names}
        return SimpleNamespace(evidence=kept, effects=tuple(kept))

    estimates = {"cubic_stiffness": SURE, "drag": NOTHING, "sense_cubic": SURE}
    monkeypatch.setattr(free_run, "without", less)
    monkeypatch.setattr(
        free_run,
        "claimed",
        lambda part, found, later: Claim(
            Errors(30.0, 3.0, 1.0, 1e4), {name: {"c": estimates[name]} for name in found.effects}
        ),
    )
    evidence = {"cubic_stiffness": 26_193.0, "drag": 3_611.0, "sense_cubic": 110.0}
    start = SimpleNamespace(evidence=evidence, effects=tuple(evidence))
    found, claim, why = free_run._promised(PROBLEM, start, RECORD)
    assert found.effects == ("cubic_stiffness",)
    assert "may as well be nothing" in why["drag"]
    assert "gains 110" in why["sense_cubic"]
    assert set(claim.effects) == {"cubic_stiffness"}


# -- what is turned down ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outcome", "reason", "says"),
    [
        (Outcome.TOO_DEAR, "gains 45e3, and 9e9 would be needed", "no more than chance"),
        (Outcome.OBJECTED, "it does not predict the rest better", "it does not predict the rest better"),
        (Outcome.BEATEN, "another explains more", "drive gain explains more for its price"),
        (Outcome.AFTER, "follows drag, which is worse", "follows drag, which is worse"),
    ],
)
def test_a_candidate_that_was_carried_is_told_with_what_it_gained(outcome: Outcome, reason: str, says: str) -> None:
    said = tried_reason(Tried("a", outcome, reason, Score(0.0, 45_000.0, 1.0, 9.0), {}), "drive_gain")
    mark = ": " if "chance" in says else "; "
    assert said == f"carried, it gains 45\u202f000 in twice the log-likelihood{mark}{says}"


@pytest.mark.parametrize(
    ("gain", "says"),
    [
        (-9.0, "carried, it gains −9.00 in twice the log-likelihood: no more than chance"),
        (-9.1, "the model with it loses 9.10 in twice the log-likelihood: the search did not reach its coefficients"),
        (-math.inf, "the model with it diverges: the search did not reach its coefficients, which"),
    ],
)
def test_a_larger_model_that_does_worse_was_not_found_and_is_not_refuted(gain: float, says: str) -> None:
    """With its coefficients at zero it would do as well as without: by more than its bar no chance takes off."""
    assert tried_reason(Tried("a", Outcome.TOO_DEAR, "", Score(0.0, gain, 1.0, 9.0), {}), None).startswith(says)


def test_a_candidate_without_a_model_is_told_by_its_reason() -> None:
    assert tried_reason(Tried("a", Outcome.IMPOSSIBLE, "no run with it", None, {}), None) == "no run with it"
