"""How a trace keeps its promises (docs/reference/trace.md): what is taken out, what is said in part."""

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from estimator.diagnosis import Fit, Verdict
from estimator.errors import DivergedError
from estimator.observer import Observer
from estimator.record import Record
from estimator.settings import Gain, ObserverSettings, ProcessNoise, Spread
from estimator.thresholds import THRESHOLDS
from estimator.trace import claims, free_run, tracing
from estimator.trace.engine import Estimate, Outcome, Score, Tried, tried_reason
from estimator.trace.nameless import Contest
from estimator.trace.probability import Account
from estimator.trace.problem import Problem
from estimator.trace.promises import Claim, Constant, Departure, Errors, Vote, in_conflict
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


@pytest.fixture
def judged(monkeypatch):
    """The verdict of a selection, where the residual is as given for each set of effects, with what is left."""

    def run(
        coefficients, gain, residuals, left=None, diverging=(), rivals=None, exact=None, likelier=None, accounts=None,
        **claimed,
    ):  # fmt: skip
        """exact, likelier: constants, and coefficients by symbol, as the likelihood has them."""
        left, asked = left or {}, []

        def exactly(part, selection, progress, *, unless_right):
            """As the likelihood has it, which is asked in any case where a constant is in conflict."""
            assert len(part.record) == SPLIT
            assert key(selection) not in asked
            asked.append(key(selection))
            progress("constants", 0, 1)
            constants = IMPOSSIBLE.get(key(selection), claimed.get("constants", ()))
            assert unless_right != in_conflict(Claim(errors(1.0, 1.0), {}, constants=constants))
            if exact is None:
                return selection
            claimed["constants"] = exact
            as_likely = {
                name: {symbol: (likelier or {}).get(symbol, one) for symbol, one in given.items()}
                for name, given in selection.coefficients.items()
            }
            return replace(selection, coefficients=as_likely)

        def key(selection):
            return tuple(selection.coefficients)

        def less(part, selection, names):
            def keep(given):
                return {name: value for name, value in given.items() if name not in names}

            return replace(selection, coefficients=keep(selection.coefficients), gain=keep(selection.gain))

        def instead(part, selection, name, other):
            def put(given, new):
                return {other if one == name else one: new if one == name else each for one, each in given.items()}

            assert len(part.record) == SPLIT
            return replace(
                selection,
                coefficients=put(selection.coefficients, SURE_OF[other]),
                gain=put(selection.gain, selection.gain[name] - 1.0),
                rivals={},
            )

        def claim(problem, selection, before, after, split):
            if (constants := IMPOSSIBLE.get(key(selection))) is not None:
                return Claim(residuals[key(selection)], selection.coefficients, constants=constants)
            return Claim(residuals[key(selection)], selection.coefficients, **claimed)

        fit = Fit((1.0, 1.0), (1.0, 1.0), 1.0, 0.5)
        seen = SimpleNamespace(held_out=fit, findings=())

        def examine(problem, split):
            if set(problem.effects) & set(diverging):
                raise DivergedError
            return seen

        monkeypatch.setattr(tracing, "examine", examine)
        monkeypatch.setattr(tracing, "without", less)
        monkeypatch.setattr(tracing, "instead", instead)
        monkeypatch.setattr(tracing, "claim_of", claim)
        monkeypatch.setattr(tracing, "exactly", exactly)

        def leftover(selection, record, resonance):
            assert resonance == pytest.approx(math.sqrt(DEVICE.target) / (2.0 * math.pi))
            return left.get(key(selection), ())

        monkeypatch.setattr(tracing, "leftover", leftover)
        selected = Selected(coefficients, gain, rivals=rivals or {}, accounts=accounts or {})
        return tracing._judged(PROBLEM, selected, seen, SPLIT)

    return run


def test_what_keeps_its_promises_is_explained(judged):
    found = judged({"drive_gain": {"hx": SURE}}, {"drive_gain": 500.0}, {("drive_gain",): errors(3.0, 1.0)})
    assert (found.verdict, set(found.named), found.share) == (Verdict.EXPLAINED, {"drive_gain"}, 1.0)
    assert not found.is_open


SURE_OF = {
    "sense_delay": {"tsx": SURE},
    "drive_gain": {"hx": SURE},
    "sense_gain": {"gy": NOTHING},
    "electrostatic_drive": {"qx": SURE},
}
IMPOSSIBLE = {("electrostatic_drive",): (Constant("kxx", -1.0, -1.1, -0.9, 1.0, 0.05, True),)}
DELAYS = {("drive_delay",): errors(1.7, 1.114), ("sense_delay",): errors(1.7, 1.002), (): errors(1.7, 1.7)}


def two_delays(judged, residuals=DELAYS, rivals=("sense_delay",), left=None, **more):
    """A drive delay, which the part that was fitted does not tell from its rivals; without one, something is left."""
    return judged(
        {"drive_delay": {"tux": SURE}},
        {"drive_delay": 2.37e7},
        residuals,
        {(): ("a line is left",), **(left or {})},
        rivals={"drive_delay": dict.fromkeys(rivals)},
        **more,
    )


def test_of_two_that_the_fitted_part_does_not_tell_apart_the_one_is_named_that_predicts_the_rest(judged):
    """A sense and a drive delay on a record whose rate changes in the part held out: 1.002 and 1.114 × the floor."""
    found = two_delays(judged)
    assert (found.verdict, set(found.named)) == (Verdict.EXPLAINED, {"sense_delay"})
    assert found.why["drive_delay"] == (
        "carried, it gains 2.37 × 10⁷ in twice the log-likelihood, as sense delay does; "
        "what is left of the part held out is 1.114 × the noise floor"
    )
    assert any(reason.startswith("drive delay is no explanation: carried, it gains") for reason in found.reasons)


@pytest.mark.parametrize(
    ("rival", "how"),
    [
        (("sense_delay",), {"residuals": DELAYS | {("sense_delay",): errors(1.7, 1.12)}}),  # no better
        (("sense_delay",), {"left": {("sense_delay",): ("a line is left",)}}),
        (("sense_delay",), {"diverging": ("sense_delay",)}),
        (("sense_gain",), {"residuals": DELAYS | {("sense_gain",): errors(1.7, 1.0)}}),  # may as well be nothing
        (
            ("electrostatic_drive",),
            {"residuals": DELAYS | {("electrostatic_drive",): errors(1.7, 1.0)}},
        ),  # a spring that does not hold
        ((), {}),
    ],
)
def test_a_rival_that_breaks_a_promise_as_well_is_not_named(judged, rival, how):
    found = two_delays(judged, rivals=rival, **how)
    assert found.verdict is not Verdict.EXPLAINED
    assert not set(found.named) & {*rival}


def test_the_next_rival_is_asked_where_the_nearest_breaks_a_promise(judged):
    found = two_delays(judged, DELAYS | {("drive_gain",): errors(1.7, 1.5)}, rivals=("drive_gain", "sense_delay"))
    assert (found.verdict, set(found.named)) == (Verdict.EXPLAINED, {"sense_delay"})


def test_where_the_part_held_out_tells_nothing_no_rival_is_asked(judged, monkeypatch):
    """It neither stood above its floor nor stands there: what refutes the one would not bear out the other."""
    monkeypatch.setattr(tracing, "_borne_out", lambda *given: pytest.fail("a rival was asked"))
    silent = errors(1.0, 1.0, gain=-1.5)
    contest = Contest(-1.5, 0.0, -1.5, 1000)
    found = two_delays(judged, {**dict.fromkeys(DELAYS, silent), ("sense_delay",): errors(1.0, 1.0)}, contest=contest)
    assert (found.verdict, set(found.named)) == (Verdict.PARTLY, {"drive_delay"})
    assert found.why == {}


def test_what_the_fitted_part_holds_no_rival_mends(judged):
    found = two_delays(judged, left={("drive_delay",): ("a line is left",)})
    assert found.verdict is not Verdict.EXPLAINED


def test_one_that_may_be_nothing_goes_and_the_rest_is_judged_anew(judged):
    """Non-reciprocal stiffness, −1.9 within −7 and 3, beside the drive gain that made it superfluous."""
    found = judged(
        {"nonreciprocal_stiffness": {"n": NOTHING}, "drive_gain": {"hx": SURE}},
        {"nonreciprocal_stiffness": 900.0, "drive_gain": 500.0},
        {("drive_gain",): errors(3.0, 1.0)},
    )
    assert (found.verdict, set(found.named)) == (Verdict.EXPLAINED, {"drive_gain"})
    assert "may as well be nothing" in found.why["nonreciprocal_stiffness"]


@pytest.mark.parametrize(("ahead", "named"), [(-0.1, {"drive_gain"}), (0.1, {"drive_gain", "drag"})])
def test_one_that_is_more_probably_nothing_than_there_is_not_named(judged, ahead, named):
    """Of one other account; the prior odds are those of the page on probabilities."""
    prior = THRESHOLDS.prior
    even = 2.0 * math.log(prior.nothing / prior.effect)
    found = judged(
        {"drag": {"dqx": SURE}, "drive_gain": {"hx": SURE}},
        {"drag": 40.0, "drive_gain": 500.0},
        {("drag", "drive_gain"): errors(3.0, 1.0), ("drive_gain",): errors(3.0, 1.0)},
        accounts={
            "drag": (Account("nothing", even + ahead), Account("drag", 0.0)),
            "drive_gain": (Account("nothing", 500.0), Account("drive_gain", 0.0)),
        },
    )
    assert (found.verdict, set(found.named)) == (Verdict.EXPLAINED, named)
    told = found.why.get("drag", "")
    assert ("more probably nothing (51%) than there" in told) == ("drag" not in named)


def test_where_nothing_is_named_it_may_well_be_nothing(judged):
    found = judged({}, {}, {(): errors(1.0, 1.0)}, accounts={None: (Account("nothing", 0.0), Account("drag", 9.0))})
    assert (found.verdict, found.named, found.why) == (Verdict.ADEQUATE, {}, {})


def test_one_with_which_the_observer_diverges_goes_and_the_rest_is_judged_anew(judged):
    """The least of them first: which one it is nobody knows."""
    found = judged(
        {"drive_delay": {"tux": SURE}, "drive_gain": {"hx": SURE}},
        {"drive_delay": 90.0, "drive_gain": 500.0},
        {("drive_gain",): errors(3.0, 1.0)},
        diverging=("drive_delay",),
    )
    assert (found.verdict, set(found.named)) == (Verdict.EXPLAINED, {"drive_gain"})
    assert found.why["drive_delay"] == "over the whole record the observer diverges with it"
    nothing = judged(
        {"drive_gain": {"hx": SURE}}, {"drive_gain": 500.0}, {(): errors(3.0, 3.0)}, {(): ("a line is left",)},
        diverging=("drive_gain",),
    )  # fmt: skip
    assert (nothing.verdict, nothing.named) == (Verdict.UNEXPLAINED, {})
    assert any("drive gain is no explanation: over the whole record" in reason for reason in nothing.reasons)


def test_friction_that_drives_is_not_named(judged):
    wrong = {"dry_friction": {"fx": Estimate(-2.0, -3.0, -1.0, positive=True)}}
    found = judged(wrong, {"dry_friction": 900.0}, {(): errors(3.0, 3.0)}, left={(): ("a line is left",)})
    assert (found.verdict, found.named) == (Verdict.UNEXPLAINED, {})
    assert found.reasons[0] == "a line is left"
    assert any("negative fx" in reason for reason in found.reasons)


def test_what_friction_that_drives_would_explain_is_left(judged):
    """What is named beside it explains a part, though the residual is the noise; where nothing is, nothing was."""
    wrong = {"drag": {"dqx": Estimate(-2.0, -3.0, -1.0, positive=True)}}
    found = judged(
        {"cubic_isotropic": {"k3": SURE}, **wrong},
        {"cubic_isotropic": 36_000.0, "drag": 861.0},
        {("cubic_isotropic",): errors(1.14, 1.008)},
    )
    assert (found.verdict, set(found.named), found.is_open) == (Verdict.PARTLY, {"cubic_isotropic"}, True)
    assert found.reasons[0].startswith("something acts like cubic isotropic")
    assert found.reasons[1] == "what drag of the other sign would explain is left: it is something else's"
    assert judged(wrong, {"drag": 861.0}, {(): errors(1.0, 1.0)}).verdict is Verdict.ADEQUATE


def test_three_laws_of_one_curve_act_like_what_made_it(judged):
    """Each is sure of itself and nothing is left; so would any curve be matched."""
    names = ("sense_cubic", "sense_clipping", "sense_quadratic")
    given, gains = {name: {"c": SURE} for name in names}, dict.fromkeys(names, 500.0)
    found = judged(given, gains, {names: errors(1.5, 1.0)})
    assert (found.verdict, set(found.named), found.is_open) == (Verdict.PARTLY, set(names), True)
    assert "are laws of one curve, what a channel reads of the displacement" in found.reasons[1]
    two = judged(
        {name: given[name] for name in names[:2]},
        {name: gains[name] for name in names[:2]},
        {names[:2]: errors(1.5, 1.0)},
    )
    assert two.verdict is Verdict.EXPLAINED


def test_a_free_run_does_not_call_a_series_its_cause_either():
    springs = ("cubic_stiffness", "quadratic_stiffness", "quintic_stiffness")
    claims_of = [Claim(errors(9.0, 1.0), {name: {"c": SURE} for name in names}) for names in (springs, springs[:2])]
    (verdict, against), (of_two, none) = (free_run.judged(claim) for claim in claims_of)
    assert (verdict, len(against)) == (Verdict.PARTLY, 1)
    assert "the force of the spring" in against[0]
    assert (of_two, none) == (Verdict.EXPLAINED, ())


def test_what_is_not_the_same_throughout_acts_so_or_goes_where_it_is_the_lesser(judged):
    """A drive delay, and a line whose size is another in each part of the record: the drive's slew."""
    residuals = {("drive_delay", "interference"): errors(1.04, 1.007), ("drive_delay",): errors(1.04, 1.02)}
    given = {"drive_delay": {"tux": SURE}, "interference": {"lcx": SURE}}
    gain = {"drive_delay": 7906.0, "interference": 394.0}
    departing = {"drive_delay": Departure(0.2, 0.0), "interference": Departure(1.0, 0.0)}
    found = judged(given, gain, residuals, departures=departing)
    assert (found.verdict, set(found.named)) == (Verdict.PARTLY, {"drive_delay"})
    assert any("other coefficients in each part" in reason for reason in found.reasons)


def test_what_the_part_held_out_does_not_bear_out_is_not_there(judged):
    found = judged(
        {"sense_gain": {"gy": SURE}},
        {"sense_gain": 53.6},
        {("sense_gain",): errors(0.9995, 0.9996, gain=-4.4), (): errors(0.9995, 0.9995, gain=0.0)},
    )
    assert (found.verdict, found.named) == (Verdict.ADEQUATE, {})
    assert any("gains 53.6" in reason and "not predicted better" in reason for reason in found.reasons)


SOFT = Constant("kxx", 46.0, 45.0, 47.0, declared=1191.0, deviation=119.0)


def test_a_residual_that_is_the_noise_is_not_adequate_with_a_constant_that_cannot_be(judged, monkeypatch):
    monkeypatch.setattr(tracing, "reconciled", lambda part, selection, progress: None)
    found = judged({}, {}, {(): errors(1.0, 1.0)}, constants=(SOFT,))
    assert (found.verdict, found.named) == (Verdict.UNEXPLAINED, {})
    assert "from the declared 1191" in found.reasons[0]


UNSURE = Constant("dyy", 49.5, 26.3, 72.8, declared=22.3, deviation=13.2, positive=True)
FAR = replace(UNSURE, value=103.4, low=79.0, high=127.7)


def test_a_constant_of_which_only_the_filter_is_sure_is_in_no_conflict(judged):
    """The damping of an axis at rest: 103 ± 12 by the filter, 50 ± 12 by the likelihood, 22 ± 13 as declared."""
    found = judged({}, {}, {(): errors(1.0, 1.0)}, constants=(FAR,), exact=(UNSURE,))
    assert found.verdict is Verdict.ADEQUATE
    assert found.undetermined == ("the record does not determine dyy: it says less of it than the bench file",)
    given = {"drive_gain": {"hx": SURE}}, {"drive_gain": 500.0}, {("drive_gain",): errors(3.0, 1.0)}
    found = judged(*given, constants=(FAR,), exact=(UNSURE,))
    assert (found.verdict, set(found.named)) == (Verdict.EXPLAINED, {"drive_gain"})


def test_what_only_the_filter_was_sure_of_is_judged_anew(judged):
    """A gain of 5 ± 1 % by the filter, and by the likelihood one that may be nothing."""
    selected = {"drag": {"dqx": SURE}, "drive_gain": {"hx": SURE}}
    residuals = {("drag", "drive_gain"): errors(3.0, 1.0), ("drag",): errors(3.0, 1.0)}
    found = judged(selected, {"drag": 900.0, "drive_gain": 500.0}, residuals, exact=(), likelier={"hx": NOTHING})
    assert (found.verdict, set(found.named)) == (Verdict.EXPLAINED, {"drag"})
    assert "may as well be nothing" in found.why["drive_gain"]


def test_what_the_record_does_not_determine_is_told_where_the_likelihood_itself_was_asked(judged):
    found = judged({}, {}, {(): errors(1.0, 1.0)}, constants=(UNSURE,))
    assert found.verdict is Verdict.ADEQUATE
    assert found.undetermined == ()


def test_where_something_is_left_no_constant_is_asked_for(judged):
    """It takes up some of what is left, and may be anything."""
    given = {"drive_gain": {"hx": SURE}}, {"drive_gain": 500.0}, {("drive_gain",): errors(3.0, 1.0)}
    found = judged(*given, {("drive_gain",): ("a line is left",)}, constants=(FAR,), exact=(UNSURE,))
    assert found.verdict is Verdict.PARTLY
    assert any("dyy comes out at 103.4" in reason for reason in found.reasons)


def test_what_lets_the_constants_be_as_declared_acts_so_and_is_not_said_to_be_the_cause(judged, monkeypatch):
    instead = Selected({"drive_gain": {"hy": SURE}}, {"drive_gain": 1616.0})
    monkeypatch.setattr(tracing, "reconciled", lambda part, selection, progress: ("drive_gain", instead))
    found = judged({}, {}, {(): errors(1.0, 1.0)}, constants=(SOFT,))
    assert (found.verdict, set(found.named)) == (Verdict.PARTLY, {"drive_gain"})
    assert found.reasons[0].startswith("something acts like drive gain")
    assert "from the declared 1191" in found.reasons[1]
    assert not found.is_open


def test_most_of_it_is_explained_in_part_by_what_dominates(judged):
    """A hardening spring that gains 191,500 and a drag that gains 646, more than three effects wanted."""
    found = judged(
        {"cubic_stiffness": {"k3x": SURE}, "drag": {"dqx": SURE}},
        {"cubic_stiffness": 191_500.0, "drag": 646.0},
        {("cubic_stiffness", "drag"): errors(12.0, 2.0), ("cubic_stiffness",): errors(12.0, 2.1)},
        left={("cubic_stiffness", "drag"): ("patchwork",), ("cubic_stiffness",): ("a line is left",)},
    )
    assert (found.verdict, set(found.named)) == (Verdict.PARTLY, {"cubic_stiffness"})
    assert found.share == pytest.approx(1.0 - (2.1**2 - 1.0) / (144.0 - 1.0))
    assert found.reasons[0].startswith("something acts like cubic stiffness: with it 97.6%")
    assert "a line is left" in found.reasons
    assert any("2.1 × the noise floor" in reason for reason in found.reasons)


def test_a_residual_that_rose_is_no_part_of_an_explanation(judged):
    found = judged(
        {"drag": {"dqx": SURE}},
        {"drag": 900.0},
        {("drag",): errors(1.8, 12.0, gain=-1e5)},
        left={("drag",): ("a line is left",)},
    )
    assert (found.verdict, found.named, found.share) == (Verdict.UNEXPLAINED, {}, None)
    assert any("rose from 1.8 to 12 ×" in reason for reason in found.reasons)


def test_the_reference_has_a_veto(judged):
    votes = (Vote("error of the angle", "rad", Errors(0.22, 0.24, 0.003, 1.0)),)
    found = judged(
        {"sense_cross_coupling": {"ex": SURE}},
        {"sense_cross_coupling": 900.0},
        {("sense_cross_coupling",): errors(3.0, 1.0), (): errors(3.0, 3.0)},
        left={(): ("a line is left",)},
        votes=votes,
    )
    assert found.verdict is Verdict.UNEXPLAINED
    assert any("the reference speaks against it" in reason for reason in found.reasons)


def test_a_constant_that_the_device_cannot_have_is_told(judged):
    odd = (Constant("kxx", 1.3, 1.29, 1.31, declared=1.0, deviation=0.05),)
    found = judged({"drag": {"dqx": SURE}}, {"drag": 900.0}, {("drag",): errors(3.0, 1.0)}, constants=odd)
    assert found.verdict is Verdict.PARTLY
    assert any("kxx" in reason and "6 standard deviations" in reason for reason in found.reasons)


# -- the claim of two axes -------------------------------------------------------------------------------------------


def test_constants_stand_beside_what_the_bench_declares() -> None:
    settings = ObserverSettings(spread=Spread(stiffness=0.01, damping=0.6, offset=0.05), gain=Gain.STATIONARY)
    model = Observer(DEVICE, replace(settings, gain=Gain.EKF, initial={"kxx": 1.7e6, "dyy": -0.4}))
    model.arrays.p[:] = np.diag(np.diag(model.arrays.p) * 1e-4)
    model.arrays.c[:] = model.arrays.p
    still = SimpleNamespace(innovation=2e-4 * np.ones((9, 2)), innovation_deviation=1e-4 * np.ones((9, 2)))
    fitted = SimpleNamespace(observer=model, estimates=still)
    found = {one.name: one for one in claims.constants_of(Problem(RECORD, DEVICE, settings), fitted)}
    assert set(found) == {"kxx", "kyy", "kxy", "dxx", "dyy", "dxy", "phi_x", "phi_y"}
    assert found["kxx"].declared == pytest.approx(1.6e6)
    assert found["kxx"].deviation == pytest.approx(0.01 * 1.61e6)
    assert found["kxx"].value == pytest.approx(1.7e6)
    # Innovations twice as large as predicted: twice the deviation.
    assert found["kxx"].high - found["kxx"].value == pytest.approx(1.96 * 2.0 * 0.01 * 0.01 * 1.61e6, rel=1e-3)
    assert found["dyy"].deviation == pytest.approx(0.6 * 1.1)
    assert found["phi_x"].deviation == pytest.approx(0.05)
    assert {name for name, one in found.items() if one.positive} == {"kxx", "kyy", "dxx", "dyy"}


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


def test_a_reference_votes_on_rate_and_angle() -> None:
    random = np.random.default_rng(2)
    channels = {"rate": 0.1 + 0.02 * random.standard_normal(N)}
    problem = replace(PROBLEM, record=replace(RECORD, channels=channels), settings=ObserverSettings(memory=0.01))
    calm = np.zeros(N)
    before, after = examined(calm, 0.041, 0.03), examined(calm + 0.04, 0.038, 0.05)
    rate, angle = claims._votes(problem, before, after, SPLIT)
    assert (rate.errors.before, rate.errors.after) == (0.03, 0.05)
    assert rate.errors.floor == pytest.approx(np.hypot(0.01, 0.02), rel=0.1)  # its own, and the reference's noise
    assert rate.errors.samples == pytest.approx(400 / 4000.0 / 0.01)
    assert rate.moved == pytest.approx(0.04)
    assert not rate.errors.at_floor
    assert (angle.errors.before, angle.errors.after, angle.errors.samples) == (0.041, 0.038, 1.0)
    assert angle.errors.floor == pytest.approx(np.hypot(0.002, 0.02 / 4000.0 * 20.0), rel=0.1)
    assert claims._votes(PROBLEM, before, after, SPLIT) == ()


def test_a_rate_may_wander_as_far_as_is_declared() -> None:
    settings = ObserverSettings(spread=Spread(rate=0.3), process_noise=ProcessNoise(rate=0.8))
    rate = np.zeros(N)
    rate[100], rate[700] = 9.0, -5.0  # only the part held out counts
    (found,) = claims._rate(replace(PROBLEM, settings=settings), examined(rate, 0.0, 0.0), SPLIT)
    assert (found.name, found.value, found.declared) == ("rate", -5.0, 0.0)
    assert found.deviation == pytest.approx(np.hypot(0.3, 0.8 * np.sqrt(N / 4000.0)))
    assert found.high == pytest.approx(-5.0 + 1.96 * 0.01, abs=1e-4)


@pytest.mark.parametrize(("share", "said"), [(Estimate(1.0, 0.9, 1.1), 1), (Estimate(0.5, 0.4, 0.6), 0)])
def test_a_level_is_in_volts_where_all_beyond_is_lost(share: Estimate, said: int) -> None:
    sense = np.zeros((N, 2))
    sense[10], sense[900] = 5.0, (0.08, -0.09)
    effects = {"sense_clipping": {"clx": share}}
    selection = SimpleNamespace(effects={"sense_clipping": {"level": 1e-4}})
    found = claims._levels(replace(PROBLEM, record=replace(RECORD, sense=sense)), selection, effects, SPLIT)
    assert len(found) == said
    for level in found:
        assert (level.low, level.high) == (pytest.approx(-0.089), pytest.approx(0.089))
        assert (level.lowest, level.highest, level.noise) == (0.0, 0.08, 1e-4)


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
