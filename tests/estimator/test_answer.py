"""What a trace of two axes answers (docs/reference/trace.md, the keys of diagnosis.json), from what was selected."""

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from estimator.diagnosis import Classes, Confusable, Diagnosis, Finding, Fit, Verdict
from estimator.record import Record
from estimator.settings import Device, ObserverSettings, Spread
from estimator.trace import tracing
from estimator.trace.engine import Estimate, Outcome, Round, Score, Tried
from estimator.trace.evidence import Evidence
from estimator.trace.nameless import Contest
from estimator.trace.probability import Account
from estimator.trace.problem import Problem
from estimator.trace.promises import Claim, Errors
from estimator.trace.searched import NOTHING, Searched
from estimator.trace.separation import Advice, Experiment

N, SPLIT = 1000, 600
DEVICE = Device(
    sample_rate=4000.0,
    stiffness=(1.6e6, 1.62e6, 2e4),
    damping=(1.0, 1.2, 0.1),
    amplitude=1e-4,
    sense_gain=(-890.0, 900.0),
    noise=(1e-4, 1e-4),
)
SETTINGS = ObserverSettings(spread=Spread(stiffness=0.01), effects={"drag": {"dqx": 1.0, "dqy": 1.0}})
RECORD = Record(np.zeros((N, 2)), np.zeros((N, 2, 1)), np.full(N, 1 / 4000.0))
PROBLEM = Problem(RECORD, DEVICE, SETTINGS)
Z = norm.ppf(0.975)


def item(name: str, gain: float, degrees: int = 2, scatter: float = 1.0) -> Evidence:
    return Evidence(name, gain, degrees, scatter, np.full(degrees, 0.1), np.arange(1.0, degrees + 1.0))


@dataclass(frozen=True)
class Look:
    """As much of a look as an answer needs."""

    watched: dict[str, dict[str, float]]
    evidence: dict[str, Evidence]


def seen(**gains: float) -> Look:
    degrees = {"sense_gain": 1, "nonreciprocal_stiffness": 1}
    return Look(
        {name: {} for name in gains},
        {name: item(name, gain, degrees.get(name, 2)) for name, gain in gains.items()},
    )


FIRST = seen(
    drive_gain=900.0, sense_gain=800.0, sense_delay=700.0, drive_delay=690.0, cubic_stiffness=300.0, dry_friction=60.0
)
LAST = seen(sense_gain=4.0, sense_delay=90.0, drive_delay=6.0, cubic_stiffness=3.0, dry_friction=1.0)
CARRIED = Tried("sense_gain", Outcome.BEATEN, "another explains more", Score(0.0, 850.0, 1.0, 9.0), {})


@dataclass(frozen=True)
class Selected:
    """A drive gain and a saturation, beside the drag that the bench file declares."""

    effects: dict[str, dict[str, float]] = field(
        default_factory=lambda: {
            "drag": {"dqx": 1.0, "dqy": 1.0},
            "drive_gain": {"hx": 0.05, "hy": 0.04},
            "drive_saturation": {"sx": 1.0, "sy": 0.9, "limit": 3.0},
        }
    )
    coefficients: dict[str, dict[str, Estimate]] = field(
        default_factory=lambda: {
            "drag": {"dqx": Estimate(1.0, -5.0, 7.0)},
            "drive_gain": {"hx": Estimate(0.05, 0.04, 0.06), "hy": Estimate(0.04, 0.03, 0.05)},
            "drive_saturation": {"sx": Estimate(1.0, 0.8, 1.2), "sy": Estimate(0.9, 0.7, 1.1)},
        }
    )
    gain: dict[str, float] = field(default_factory=lambda: {"drive_gain": 900.0, "drive_saturation": 500.0})
    rounds: tuple[Any, ...] = (
        Round(FIRST, (CARRIED,), "drive_gain"), Round(LAST, (), "drive_saturation"), Round(LAST, (), None),
    )  # fmt: skip
    alike: dict[str, dict[str, float]] = field(
        default_factory=lambda: {
            "drive_gain": {"sense_gain": 0.5, "drive_gain:2": 0.99999, "sense_delay": 0.99925, "drive_delay": 0.99915},
            "drive_saturation": {"dry_friction": 0.95},
        }
    )
    rivals: dict[str, dict[str, Any]] = field(
        default_factory=lambda: {
            "drive_gain": {"sense_gain:2": SimpleNamespace(parameters={"p": 7.0})},
            "drive_saturation": {},
        }
    )
    searched: dict[str, Searched] = field(
        default_factory=lambda: {
            "drive_gain": NOTHING,
            "drive_saturation": Searched(("limit",), np.array([[0.25]]), np.zeros((2, 1))),
        }
    )
    accounts: Any = field(
        default_factory=lambda: {
            "drive_gain": (Account("drive_gain", 0.0), Account("nothing", 900.0)),
            "drive_saturation": (Account("drive_saturation", 0.0), Account("nothing", 500.0)),
        }
    )
    after: Any = field(
        default_factory=lambda: SimpleNamespace(
            likelihood=0.0,
            observer="after",
            settings=SETTINGS,
            estimates=SimpleNamespace(innovation=2e-4 * np.ones((9, 2)), innovation_deviation=1e-4 * np.ones((9, 2))),
        )
    )
    patchwork: bool = False
    samples: int = 600


class Reader:
    """Angles that depend on nothing but the names."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def bound(self, effects: Any, name: str, covariance: Any) -> float:
        return {"drive_gain": 0.01, "drive_saturation": 0.02}[name] * float(covariance)

    def moved(self, known: Any, effects: Any) -> float:
        return float(len(effects) - len(known))

    def mistaken(self, effects: Any, name: str, other: str, given: Any) -> float:
        return 0.001 * len(other) + float(given.get("p", 0.0))


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The answer to a record of which that was selected, and what was asked on the way."""

    def run(selection: Any, residual: Errors, left: Any = (), equivalents: Any = (), contest: Any = None) -> Any:
        asked = SimpleNamespace(told=[], pairs=None, bounds=None)

        def examine(problem: Problem, split: int) -> Any:
            carried = len(problem.effects) - 1.0
            ratios = [3.0 - carried + more for more in (0.0, 0.5)]
            fits = [Fit((ratio, ratio), (1.0, 1.0), ratio, 0.5) for ratio in ratios]
            finding = Finding("line", f"{carried:g} carried", 1.0, 9.0)
            return SimpleNamespace(fitted=fits[0], held_out=fits[1], findings=(finding,), residual=("of", carried))

        def separations(pairs: Any, of: Any, problem: Problem, progress: Any) -> Any:
            asked.pairs = list(pairs)
            return [
                Advice(Experiment("something", "do"), 0.1 * n, 10.0 * n, "do something") for n, _ in enumerate(pairs, 1)
            ]

        def bounds(problem: Problem, model: Any, watched: Any) -> Any:
            asked.bounds = (len(problem.record), model, set(watched))
            return {
                name: replace(one, coefficients=one.coefficients + 0.4, deviation=one.deviation * (one.degrees - 1))
                for name, one in selection.rounds[-1].look.evidence.items()
            }

        def same(intervals: Any, constants: Any, nonreciprocal: Any) -> Any:
            asked.same = (intervals, constants, nonreciprocal)
            return equivalents

        def claim(problem: Problem, of: Any, before: Any, after: Any, split: int) -> Claim:
            named = {name: given for name, given in of.coefficients.items() if name != "drag"}
            return Claim(residual, named, contest=contest)

        monkeypatch.setattr(tracing, "require_traceable", lambda record, device, split: None)
        monkeypatch.setattr(tracing, "loses_what_a_free_run_follows", lambda part: False)
        monkeypatch.setattr(tracing, "select", lambda part, progress: selection)
        monkeypatch.setattr(tracing, "examine", examine)
        monkeypatch.setattr(tracing, "claim_of", claim)
        monkeypatch.setattr(tracing, "leftover", lambda of, record, resonance: left(of) if callable(left) else left)
        monkeypatch.setattr(tracing, "exactly", lambda part, selected, progress, unless_right: selected)
        monkeypatch.setattr(tracing, "bounds", bounds)
        monkeypatch.setattr(tracing, "AngleReader", Reader)
        monkeypatch.setattr(tracing, "separations", separations)
        monkeypatch.setattr(tracing, "equivalents", same)
        monkeypatch.setattr(tracing, "covariance_of", lambda name, model, searched: 1.0 + len(searched.names))
        monkeypatch.setattr(tracing, "constants_of", lambda observer: {"kxx": 1.7e6, "dyy": 1.5})
        monkeypatch.setattr(
            tracing,
            "without",
            lambda part, of, names: replace(
                of,
                gain={name: gain for name, gain in of.gain.items() if name not in names},
                effects={name: given for name, given in of.effects.items() if name not in names},
                coefficients={name: given for name, given in of.coefficients.items() if name not in names},
            ),
        )
        said = tracing.trace(PROBLEM, split=SPLIT, progress=lambda *what: asked.told.append(what))
        assert isinstance(said, Diagnosis)
        return said, asked

    return run


EXPLAINED = Errors(3.0, 1.0, 1.0, 1e5, gain=1e3)


def test_an_effect_is_told_with_its_interval_its_evidence_and_what_it_leaves_of_the_angle(answered: Any) -> None:
    said, asked = answered(Selected(), EXPLAINED)
    assert (said.verdict, said.share, said.split) == (Verdict.EXPLAINED, 1.0, SPLIT)
    gain, saturation = said.effects
    assert (gain.name, gain.evidence, gain.angle_bound) == ("drive_gain", 900.0, 0.01)
    assert gain.undone == "the control law divides by it"
    assert (saturation.evidence, saturation.angle_bound) == (500.0, 0.04)
    assert {symbol: (one.value, one.low, one.high) for symbol, one in gain.coefficients.items()} == {
        "hx": (0.05, 0.04, 0.06), "hy": (0.04, 0.03, 0.05),
    }  # fmt: skip
    # Deviation 0.5 of the limit, innovations twice as large as predicted.
    limit = saturation.coefficients["limit"]
    assert (limit.value, limit.unit) == (3.0, "m/s²")
    assert (limit.low, limit.high) == (pytest.approx(3.0 - Z), pytest.approx(3.0 + Z))
    assert said.angle_moved == 2.0
    assert asked.bounds[0] == SPLIT
    assert asked.told[-1] == ("before and after", 2, 2)
    assert ("before and after", 1, 2) in asked.told


def test_before_is_without_and_after_with_what_is_named_and_each_part_by_itself(answered: Any) -> None:
    said, _ = answered(Selected(), EXPLAINED)
    ratios = [one.ratio for one in (said.before, said.after, said.held_out_before, said.held_out_after)]
    assert ratios == [3.0, 1.0, 3.5, 1.5]
    assert [one.text for one in said.findings] == ["0 carried"]
    assert (said.residual_before, said.residual_after) == (("of", 0.0), ("of", 2.0))
    assert said.left == ()
    assert said.reasons[0] == "the innovation of the part held out is 1.5 × the noise floor, and was 3.5 ×"
    assert said.reasons[1] == "none of the 5 other effects looked for explains more than chance would"


def test_probabilities_are_of_each_effect_that_is_named(answered: Any) -> None:
    said, _ = answered(Selected(), EXPLAINED)
    assert [one.effect for one in said.probabilities] == ["drive_gain", "drive_saturation"]
    for one in said.probabilities:
        assert isinstance(one, Classes)
        assert sum(one.probabilities.values()) == pytest.approx(1.0)


def test_look_alikes_are_those_of_another_kind_by_likelihood_or_signature(answered: Any) -> None:
    """Above a likeness of 0.9992, and of each kind one."""
    said, asked = answered(Selected(), EXPLAINED)
    assert asked.pairs == [("drive_gain", "sense_gain:2"), ("drive_gain", "sense_delay")]
    by_likelihood, by_signature = said.confusable
    assert (by_likelihood.effect, by_likelihood.other) == ("drive_gain", "sense_gain")
    assert math.isnan(by_likelihood.correlation)
    assert (by_likelihood.separate_by, by_likelihood.expected) == ("do something", 0.1)
    assert by_likelihood.angle_apart == pytest.approx(7.012)
    assert by_signature == Confusable(
        "drive_gain", "sense_delay", 0.99925, "do something", 0.2, pytest.approx(0.011), "something", 20.0
    )


@pytest.mark.parametrize(
    ("deficit", "dispersion", "behind"), [(40.0, 1.0, 40.0), (5.9, 1.0, None), (6.1, 1.0, 6.1), (11.9, 2.0, None)]
)
def test_who_is_told_apart_once_carried_needs_no_experiment(
    answered: Any, deficit: float, dispersion: float, behind: float | None
) -> None:
    """By odds of 20 to 1, twice their logarithm times the dispersion; where it was only watched, nothing is known."""
    carried = Tried("sense_delay", Outcome.BEATEN, "another explains more", Score(0.0, 850.0, 1.0, 9.0), {})
    accounts = {
        "drive_gain": (Account("drive_gain", 0.0), Account("sense_delay", deficit, dispersion)),
        "drive_saturation": (Account("drive_saturation", 0.0),),
    }
    for tried in ((CARRIED,), (CARRIED, carried)):
        rounds = (Round(FIRST, tried, "drive_gain"), *Selected().rounds[1:])
        said, asked = answered(Selected(rounds=rounds, accounts=accounts), EXPLAINED)
        (one,) = (one for one in said.confusable if one.other == "sense_delay")
        told = behind if carried in tried else None
        assert one.behind == told
        assert (("drive_gain", "sense_delay") in asked.pairs) is (told is None)
        assert (one.separate_by is None) is (told is not None)


def test_what_the_equations_cannot_tell_is_told_beside_it(answered: Any) -> None:
    other = SimpleNamespace(effect="drive_gain", other="clock_rate", told_by="compare clocks", angle=0.0)
    again = SimpleNamespace(effect="drive_gain", other="sense_delay", told_by="time it", angle=None)
    said, asked = answered(Selected(), EXPLAINED, equivalents=(other, again))
    assert said.confusable[1:] == (
        Confusable("drive_gain", "sense_delay", 1.0, "time it", None, None),
        Confusable("drive_gain", "clock_rate", 1.0, "compare clocks", None, 0.0),
    )
    intervals, constants, nonreciprocal = asked.same
    assert set(intervals) == {"drive_gain", "drive_saturation"}
    assert constants.stiffness == (1.7e6, 1.62e6, 2e4)  # as found, else as declared
    assert constants.damping == (1.0, 1.5, 0.1)
    assert constants.declared == DEVICE.stiffness
    assert constants.spread == pytest.approx(0.01 * DEVICE.target)
    assert nonreciprocal is None


def test_a_stiffness_that_is_not_symmetric_counts_as_far_as_the_last_look_knows_it(answered: Any) -> None:
    rounds = (*Selected().rounds[:2], Round(seen(nonreciprocal_stiffness=4.0), (), None))
    _, asked = answered(Selected(rounds=rounds), EXPLAINED)
    kn = asked.same[2]
    assert (kn.value, kn.low, kn.high) == (0.1, pytest.approx(0.1 - Z), pytest.approx(0.1 + Z))


def test_every_other_candidate_is_rejected_once_with_a_reason_and_a_bound(answered: Any) -> None:
    said, _ = answered(Selected(), EXPLAINED)
    rejected = {one.name: one for one in said.rejected}
    assert list(rejected) == ["sense_gain", "sense_delay", "drive_delay", "cubic_stiffness", "dry_friction"]
    assert rejected["sense_gain"].reason == (
        "carried, it gains 850 in twice the log-likelihood; drive gain explains more for its price"
    )
    assert rejected["sense_delay"].reason.startswith("looks like what was taken (likeness 0.99925)")
    assert rejected["drive_delay"].reason == "nothing is left for it (likeness 0.999 to what was taken)"
    assert rejected["cubic_stiffness"].reason == "explains no more than chance would"
    assert rejected["dry_friction"].reason == "nothing is left for it (likeness 0.950 to what was taken)"
    assert rejected["sense_delay"].evidence == 700.0  # of the first look, beside nothing
    assert rejected["sense_gain"].gain == 850.0  # carried: the number of its reason
    assert rejected["sense_delay"].gain is None
    assert rejected["cubic_stiffness"].bound.keys() == {"k3x", "k3y"}
    bound = rejected["cubic_stiffness"].bound["k3y"]
    both = np.sqrt(-2.0 * np.log(0.05))  # χ² of two in closed form
    assert (bound.value, bound.high) == (0.5, pytest.approx(0.5 + 2.0 * both))
    assert rejected["sense_gain"].bound == {}  # of which the record says nothing


def test_what_scatters_from_part_to_part_is_told_so(answered: Any) -> None:
    less = Selected(alike={"drive_gain": {}, "drive_saturation": {}})
    said, _ = answered(less, EXPLAINED)
    (delay,) = (one for one in said.rejected if one.name == "sense_delay")
    assert delay.reason == "what it would explain is not the same from part to part of the record"
    (other,) = (one for one in said.rejected if one.name == "drive_delay")
    assert other.reason == "explains no more than chance would"


def test_what_would_gain_much_and_scatters_more_is_told_with_both(answered: Any) -> None:
    """A stranger's record: the truth would have gained 7,238, was not carried, and was "no more than chance"."""
    rough = replace(LAST.evidence["drive_delay"], gain=7238.0, scatter=458.0)
    last = replace(LAST, evidence={**LAST.evidence, "drive_delay": rough})
    rounds = (*Selected().rounds[:2], Round(last, (), None))
    said, _ = answered(Selected(rounds=rounds, alike={"drive_gain": {}, "drive_saturation": {}}), EXPLAINED)
    (delay,) = (one for one in said.rejected if one.name == "drive_delay")
    assert delay.reason == (
        "would gain 7240 in twice the log-likelihood, but what it would explain differs from part to part of the "
        "record by 458 times the power of noise"
    )


def test_what_is_as_significant_as_chance_makes_one_explains_no_more(
    monkeypatch: pytest.MonkeyPatch, answered: Any
) -> None:
    monkeypatch.setattr(tracing, "threshold", lambda candidates: LAST.evidence["sense_delay"].significance)
    said, _ = answered(Selected(alike={"drive_gain": {}, "drive_saturation": {}}), EXPLAINED)
    (delay,) = (one for one in said.rejected if one.name == "sense_delay")
    assert delay.reason == "explains no more than chance would"


def test_a_parameter_that_nobody_searched_for_is_none_of_what_was_found(answered: Any) -> None:
    said, _ = answered(Selected(searched=dict.fromkeys(("drive_gain", "drive_saturation"), NOTHING)), EXPLAINED)
    assert {one.name: set(one.coefficients) for one in said.effects} == {
        "drive_gain": {"hx", "hy"},
        "drive_saturation": {"sx", "sy"},
    }


def test_a_parameter_that_is_the_same_number_as_a_coefficient_is_as_sure_as_that() -> None:
    """And none is told that the effect was not given."""
    corners = {"hpx": Estimate(30.0, 20.0, 40.0), **dict.fromkeys(("hpy", "odx", "ody"), Estimate(5.0, 4.0, 6.0))}
    selection: Any = Selected(
        effects={"sense_high_pass": {"hpx": 30.0, "hpy": 5.0, "odx": 5.0, "ody": 5.0, "leak_x": 29.5}},
        coefficients={"sense_high_pass": corners}, searched={"sense_high_pass": NOTHING},
    )  # fmt: skip
    found = tracing._intervals("sense_high_pass", selection, DEVICE)
    assert set(found) == {"hpx", "hpy", "odx", "ody", "leak_x"}
    assert (found["leak_x"].value, found["leak_x"].low, found["leak_x"].high) == (29.5, 20.0, 40.0)
    assert found["leak_x"].unit == "1/s"


def test_what_is_left_is_looked_for_in_all_that_was_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[np.ndarray] = []
    monkeypatch.setattr(tracing, "leftover", lambda of, record, resonance: seen.append(record.sense[:, 0]) or ("one",))
    rows = np.arange(20.0)
    record = Record(np.stack([rows, rows], axis=1), np.zeros((20, 2, 1)), np.full(20, 1e-3))
    selection: Any = Selected(samples=12)
    assert tracing._left(Problem(record, DEVICE, SETTINGS), selection) == ("one",)
    np.testing.assert_array_equal(seen[0], rows[:12])


def test_of_a_part_something_is_left_and_told(answered: Any) -> None:
    said, _ = answered(Selected(), Errors(3.0, 1.5, 1.0, 1e5, gain=1e3), left=("a line is left at 5 Hz",))
    assert said.verdict is Verdict.PARTLY
    assert said.share == pytest.approx(1.0 - 1.25 / 8.0)
    assert [one.text for one in said.left] == ["2 carried"]
    assert said.reasons[0].startswith("something acts like drive gain and drive saturation: with them 84.4%")


def test_where_nothing_is_named_all_that_was_selected_is_rejected_with_its_gain(answered: Any) -> None:
    said, _ = answered(Selected(), Errors(3.0, 2.9, 1.0, 1e5, gain=1e3), left=("a line is left at 5 Hz",))
    assert (said.verdict, said.effects, said.share, said.left) == (Verdict.UNEXPLAINED, (), None, ())
    first, second, *_ = said.rejected
    assert (first.name, first.evidence, first.gain) == ("drive_gain", 900.0, 900.0)
    sizes = {symbol: (one.value, one.low, one.high) for symbol, one in first.bound.items()}
    assert sizes == {"hx": (0.05, 0.0, 0.06), "hy": (0.04, 0.0, 0.05)}  # as it was carried, or nothing
    assert first.reason == "carried, it gains 900 in twice the log-likelihood and leaves the rest"
    assert (second.name, second.evidence) == ("drive_saturation", None)
    assert said.held_out_after == said.held_out_before  # what is not named stands beside no figure
    assert said.angle_moved == 2.0
    assert said.confusable == ()


@pytest.mark.parametrize("left", [("a line is left at 5 Hz",), ()])
def test_effects_that_the_beginning_alone_shows_are_told_as_a_part_where_something_is_left_without_them(
    answered: Any, left: tuple[str, ...]
) -> None:
    """Nothing is left with them, and the part held out says nothing of them; without them, that of the beginning is."""
    silent = Errors(1.02, 1.02, 1.0, 1e5, gain=-1.5)
    said, _ = answered(
        Selected(), silent, left=lambda of: left if not of.gain else (), contest=Contest(-1.5, 0.0, -1.5, 1000)
    )
    if not left:
        assert (said.verdict, said.effects) == (Verdict.ADEQUATE, ())
        return
    assert said.verdict is Verdict.PARTLY
    assert [one.name for one in said.effects] == ["drive_gain", "drive_saturation"]
    assert (said.share, said.held_out_after.ratio) == (None, 1.5)
    assert said.reasons[0].startswith("something acts like drive gain and drive saturation: with them nothing is left")
    assert said.reasons[0].endswith("tells neither for nor against it")


def test_a_record_that_lacks_nothing_moves_no_angle(answered: Any) -> None:
    known = {"drag": {"dqx": 1.0, "dqy": 1.0}}
    none = Selected(
        effects=known, coefficients={}, gain={}, rounds=(Round(LAST, (), None),), alike={}, rivals={},
        accounts={None: (Account("nothing", 0.0), Account("drag", 5.0))},
    )  # fmt: skip
    said, _ = answered(none, Errors(1.0, 1.0, 1.0, 1e5, gain=0.0))
    assert (said.verdict, said.effects, said.angle_moved, said.share) == (Verdict.ADEQUATE, (), None, None)
    assert said.before == said.after
    assert said.reasons == (
        "the innovation of the part held out is 3.5 × the noise floor",
        "none of the 5 effects looked for explains more than chance would",
    )
    (delay,) = (one for one in said.rejected if one.name == "sense_delay")
    assert delay.reason == "what it would explain is not the same from part to part of the record"
    assert [one.effect for one in said.probabilities] == [None]


def test_several_of_a_kind_keep_their_labels() -> None:
    named = {"interference": {}, "interference:1": {}, "drive_gain": {}}
    assert [tracing._short(name, named) for name in named] == ["interference", "interference:1", "drive_gain"]
    assert tracing._short("interference:1", {"interference:1": {}}) == "interference"


@pytest.mark.parametrize(("axes", "freely", "by_free_run"), [(1, False, True), (2, True, True), (2, False, False)])
def test_a_single_axis_and_a_free_response_that_is_lost_go_by_the_free_run(
    monkeypatch: pytest.MonkeyPatch, axes: int, *, freely: bool, by_free_run: bool
) -> None:
    asked: list[Any] = []
    single = replace(
        DEVICE, stiffness=DEVICE.stiffness[:1], damping=DEVICE.damping[:1], sense_gain=(-890.0,), noise=(1e-4,)
    )
    monkeypatch.setattr(tracing, "require_traceable", lambda *given: asked.append(given))
    monkeypatch.setattr(tracing, "loses_what_a_free_run_follows", lambda part: len(part.record) == SPLIT and freely)
    monkeypatch.setattr(tracing, "trace_free_run", lambda problem, **given: given)

    def together(*pieces: Any) -> Any:
        raise InterruptedError

    monkeypatch.setattr(tracing, "together", together)
    problem = replace(PROBLEM, device=single if axes == 1 else DEVICE)
    if by_free_run:
        assert tracing.trace(problem, split=SPLIT)["split"] == SPLIT  # type: ignore[index]
    else:
        with pytest.raises(InterruptedError):
            tracing.trace(problem, split=SPLIT)
    assert asked == [(RECORD, problem.device, SPLIT)]


def conflict(monkeypatch: pytest.MonkeyPatch, found: Any) -> Any:
    monkeypatch.setattr(tracing, "reconciled", lambda part, of, progress: found if len(part.record) == SPLIT else 1)
    monkeypatch.setattr(tracing, "examine", lambda problem, split: ("examined with", set(problem.effects), split))
    after: Any = "after"
    return tracing._in_conflict(
        PROBLEM,
        Selected(),
        after,
        SPLIT,
        {"drag": "why"},
        ("k is off",),
        lambda *what: None,  # type: ignore[arg-type]
    )


def test_a_constant_that_cannot_be_leaves_the_record_open_and_what_would_let_it_be_acts_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nothing = conflict(monkeypatch, None)
    assert (nothing.verdict, nothing.named, nothing.after) == (Verdict.UNEXPLAINED, {}, "after")
    assert (nothing.reasons, nothing.why, nothing.is_open) == (("k is off",), {"drag": "why"}, True)
    assert (nothing.share, nothing.contest) == (None, None)
    instead = Selected(effects={"drag": {"dqx": 1.0}, "dry_friction:1": {"fx": 2.0}})
    some = conflict(monkeypatch, ("dry_friction:1", instead))
    assert (some.verdict, some.named) == (Verdict.PARTLY, {"dry_friction:1": {"fx": 2.0}})
    assert some.selection is instead
    assert some.after == ("examined with", {"drag", "dry_friction:1"}, SPLIT)
    assert some.reasons == (
        "something acts like dry friction: with it every constant of the model is one that the bench file allows",
        "k is off",
    )
    assert (some.is_open, some.share, some.contest) == (False, None, None)


def test_it_is_said_how_many_kinds_the_last_look_looked_for() -> None:
    """Kinds that are named, or were selected and are not, are no others."""
    fits = [Fit((1.0,), (1.0,), ratio, 0.5) for ratio in (3.25, 1.125)]
    named: Any = {"drive_gain": {}}
    said = tracing._reasons(named, Selected(), *fits, {})  # type: ignore[arg-type]
    assert said[:2] == (
        "the innovation of the part held out is 1.125 × the noise floor, and was 3.25 ×",
        "none of the 5 other effects looked for explains more than chance would",
    )
    why = {"dry_friction": "it gains too little"}
    less = tracing._reasons({}, Selected(), *fits, why)  # type: ignore[arg-type]
    assert less == (
        "the innovation of the part held out is 1.125 × the noise floor",
        "none of the 4 other effects looked for explains more than chance would",
        "dry friction is no explanation: it gains too little",
    )
    none = tracing._reasons({}, Selected(), *fits, {})  # type: ignore[arg-type]
    assert none[1] == "none of the 5 effects looked for explains more than chance would"


def test_constants_are_as_found_or_as_declared() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracing, "constants_of", lambda observer: {"kxx": 1.7e6, "dyy": 1.5, "dxy": 0.7})
        found = tracing._constants(Selected(), DEVICE, SETTINGS)  # type: ignore[arg-type]
    assert (found.stiffness, found.damping) == ((1.7e6, 1.62e6, 2e4), (1.0, 1.5, 0.7))
    assert (found.declared, found.spread) == (DEVICE.stiffness, pytest.approx(0.01 * DEVICE.target))
