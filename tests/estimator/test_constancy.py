"""Whether coefficients are the same throughout: beside least squares, by chance alone, and on a drive that changes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from estimator.identification.experiments import EXPERIMENTS, loop_record
from estimator.record import Record
from estimator.thresholds import THRESHOLDS
from estimator.trace import constancy as module
from estimator.trace.constancy import Constancy, constancies, constancy
from estimator.trace.fitting import fit
from estimator.trace.problem import Problem
from estimator.trace.scan import PARTS
from tests.estimator.test_scan import DEVICE, SETTINGS

ROWS = 40


def seen(signature, innovation):
    """What a scan keeps of a signature (parts, rows, k) and of white innovations (parts, rows)."""
    normal = np.einsum("pri,prj->pij", signature, signature)
    score = np.einsum("pri,pr->pi", signature, innovation)
    return SimpleNamespace(columns={"law": slice(0, signature.shape[2])}, normal=normal, score=score)


def misfit(signature, innovation):
    """Sum of squares that least squares leave."""
    found, *_ = np.linalg.lstsq(signature, innovation, rcond=None)
    return float(np.sum((innovation - signature @ found) ** 2))


def test_the_gain_is_what_least_squares_of_each_part_leave_less_than_those_of_all() -> None:
    random = np.random.default_rng(1)
    signature = random.standard_normal((PARTS, ROWS, 2))
    innovation = random.standard_normal((PARTS, ROWS)) + signature[:, :, 0] * np.linspace(-1.0, 3.0, PARTS)[:, None]
    each = sum(misfit(*part) for part in zip(signature, innovation, strict=True))
    one = misfit(signature.reshape(-1, 2), innovation.ravel())
    found = constancy(seen(signature, innovation), "law")
    assert found.gain == pytest.approx(one - each)
    assert found.degrees == 2 * PARTS - 2
    assert found.excess == pytest.approx(found.gain - found.degrees)
    assert found.chance < 1e-100


def test_a_coefficient_that_is_off_by_as_much_everywhere_is_constant() -> None:
    random = np.random.default_rng(2)
    signature = random.standard_normal((PARTS, ROWS, 1))
    noise = random.standard_normal((PARTS, ROWS))
    right, off = (constancy(seen(signature, noise + by * signature[:, :, 0]), "law") for by in (0.0, 5.0))
    assert off.gain == pytest.approx(right.gain)


def test_a_part_whose_equations_are_no_numbers_says_nothing() -> None:
    random = np.random.default_rng(4)
    signature, noise = random.standard_normal((PARTS, ROWS, 2)), random.standard_normal((PARTS, ROWS))
    rest = constancy(seen(signature[1:], noise[1:]), "law")
    lost = seen(signature, noise)
    lost.normal[0, 1, 1] = np.nan
    assert constancy(lost, "law") == rest
    lost.score[1:, 0] = np.inf
    assert constancy(lost, "law") == Constancy(0.0, 0)


@pytest.mark.moderate
def test_white_innovations_are_as_probable_as_chance_says() -> None:
    random = np.random.default_rng(3)
    # As large in one part as in another it need not be: a drive that is off for a while.
    signature = random.standard_normal((PARTS, ROWS, 2)) * np.geomspace(1.0, 30.0, PARTS)[:, None, None]
    chances = [constancy(seen(signature, random.standard_normal((PARTS, ROWS))), "law").chance for _ in range(400)]
    assert kstest(chances, "uniform").pvalue > 1e-3


def test_a_part_that_says_nothing_of_a_coefficient_counts_for_none() -> None:
    random = np.random.default_rng(4)
    signature = random.standard_normal((PARTS, ROWS, 1))
    signature[:8] = 0.0
    assert constancy(seen(signature, random.standard_normal((PARTS, ROWS))), "law").degrees == PARTS - 8 - 1


def test_less_than_chance_is_no_excess() -> None:
    assert Constancy(gain=20.0, degrees=31).excess == 0.0
    assert Constancy(gain=2.0, degrees=2).excess == 0.0
    assert Constancy(gain=2.5, degrees=2).excess == 0.5
    assert Constancy(gain=0.0, degrees=0).chance == 1.0
    assert Constancy(gain=3.841, degrees=1).chance == pytest.approx(0.05, rel=1e-3)  # of one degree: 1.96²


@pytest.mark.slow
@pytest.mark.parametrize("swing", [0.0, 0.03])
def test_a_drive_gain_that_changes_on_the_way_is_seen_and_one_that_does_not_is_not(swing: float) -> None:
    experiment = next(one for one in EXPERIMENTS if one.name == "all")
    record = loop_record(experiment, DEVICE, SETTINGS, latency=1)
    gain = 1.05 + swing * np.sign(np.sin(2.0 * np.pi * 3.0 * np.arange(len(record)) / len(record)))
    problem = Problem(replace(record, drive=record.drive / gain[:, None, None]), DEVICE, SETTINGS)
    model = fit(problem.carrying({"drive_gain": {}}))
    found = constancies(problem, model, ["drive_gain"])["drive_gain"]
    assert (found.chance < 1e-4) is (swing > 0.0)


@pytest.mark.slow
def test_what_an_observer_has_learnt_of_a_coefficient_is_not_asked_of_what_it_left() -> None:
    """A sense gain that is 10 % off is so throughout, however far it is from where the observer began."""
    experiment = next(one for one in EXPERIMENTS if one.name == "all")
    record = loop_record(experiment, DEVICE, SETTINGS, latency=1)
    problem = Problem(replace(record, sense=record.sense * [1.0, 0.9]), DEVICE, SETTINGS)
    model = fit(problem.carrying({"sense_gain": {}}))
    found = constancies(problem, model, ["sense_gain"])["sense_gain"]
    assert found.degrees == 31
    assert found.chance > 1e-4


def test_what_a_model_carries_is_watched_once_more_where_the_choice_was_confirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each under a label of its own, with its parameters, by the observer that the model is scanned with."""
    asked = []
    given = {"drive_gain": {}, "interference:2": {"omega": 7.0}}
    model = SimpleNamespace(likelihood=1.0, observer="observer")
    settings = replace(SETTINGS, memory=9.0)
    samples = THRESHOLDS.choice.confirmed + 3
    record = Record(np.zeros((samples, 2)), np.zeros((samples, 2, 1)), np.arange(1.0, samples + 1.0))

    def scan(problem: Problem, watched: dict[str, dict[str, float]], observer: str, *, held: bool) -> str:
        assert held
        asked.append((problem.record.step[[0, -1]].tolist(), problem.settings, watched, observer))
        return "seen"

    monkeypatch.setattr(module, "scanned_with", lambda model, device, bench: settings)
    monkeypatch.setattr(module, "parameters_of", lambda model, name: given[name])
    monkeypatch.setattr(module, "scan", scan)
    monkeypatch.setattr(module, "constancy", lambda seen, label: (seen, label))
    found = constancies(Problem(record, DEVICE, SETTINGS), model, list(given))
    watched = {"drive_gain:again0": {}, "interference:again1": {"omega": 7.0}}
    assert asked == [([1.0, float(THRESHOLDS.choice.confirmed)], settings, watched, "observer")]
    assert found == {name: ("seen", label) for name, label in zip(given, watched, strict=True)}


def test_nothing_is_asked_of_no_effect_or_of_a_model_that_has_no_likelihood() -> None:
    diverged = SimpleNamespace(likelihood=-np.inf)
    record = SimpleNamespace(part=lambda rows: None)
    assert constancies(Problem(record, DEVICE, SETTINGS), diverged, ["drag"]) == {}
    assert constancies(Problem(record, DEVICE, SETTINGS), SimpleNamespace(likelihood=1.0), []) == {}
