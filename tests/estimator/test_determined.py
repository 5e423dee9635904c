"""What is declared of a constant counts in a free run, and what the record does not determine is said."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from estimator.identification.problem import Problem
from estimator.observer import Observer
from estimator.record import Record
from estimator.refinement import Declared, refine
from estimator.settings import Device, ObserverSettings, Spread
from estimator.simulation import simulate
from estimator.trace import determined
from estimator.trace.determined import declared, undetermined, unsettled
from estimator.trace.free_run_model import fitted

RATE = 600.0
DEVICE = Device(
    sample_rate=RATE, stiffness=(1.9e5,), damping=(40.0,), amplitude=0.1, sense_gain=(2.0,), noise=(1e-4,)
)  # fmt: skip
OBSERVER = Observer(DEVICE, ObserverSettings(spread=Spread(stiffness=0.05, damping=0.5, drive_gain=0.1, offset=0.01)))
N = 3000
NOISE = np.random.default_rng(1).standard_normal((N, 1))
TRUE = {"kxx": 1.97e5, "dxx": 46.0, "drive_gain_x": 1.08, "phi_x": 0.004}


def record(drive, noise=NOISE, **values):
    state = OBSERVER.state.copy()
    for name, value in (TRUE | values).items():
        state[OBSERVER.names.index(name)] = value
    return simulate(OBSERVER, state, drive).sensed + DEVICE.noise[0] * noise


def slow(size: float = 2e2, frequency_Hz: float = 0.7):
    return size * np.sin(2.0 * math.pi * frequency_Hz * np.arange(N) / RATE)[:, None]


def test_what_is_declared_exactly_is_not_fitted_but_an_offset_is() -> None:
    sure = Observer(DEVICE, ObserverSettings(spread=Spread(drive_gain=0.0, offset=0.0)))
    assert unsettled(sure) == ("x", "vx", "phi_x", "kxx", "dxx")
    assert unsettled(OBSERVER) == OBSERVER.estimated


@pytest.mark.moderate
def test_a_free_decay_leaves_a_drive_gain_that_is_known_what_it_is() -> None:
    """It says nothing of it: fitted all the same, it ran to 10¹⁶."""
    decay = record(np.zeros((N, 1)), x=0.1, drive_gain_x=1.0)
    settings = ObserverSettings(spread=Spread(stiffness=0.05, damping=0.5, drive_gain=0.0, offset=0.01))
    problem = Problem(Record(decay, np.zeros((N, 1, 1)), np.full(N, 1.0 / RATE)), DEVICE, settings)
    fit = fitted(problem, (), None, slice(0, N)).fit
    assert "drive_gain_x" not in fit.free
    assert fit.value("drive_gain_x") == 1.0
    assert fit.value("kxx") == pytest.approx(TRUE["kxx"], rel=1e-5)


def at(fit, name):
    return fit.value(name), fit.deviation[fit.names.index(name)]


@pytest.mark.moderate
def test_what_is_declared_is_one_more_observation_of_the_constant() -> None:
    """An offset in white noise: mean and variance weighed by their information."""
    few = 2000
    drive = np.zeros((few, 1))
    sense = 0.004 + 1e-4 * NOISE[:few]
    initial = Declared(0.00401, 3e-6)
    fit = refine(OBSERVER, sense, drive, free=("phi_x",), known={"phi_x": initial})
    volts = float(np.mean(sense))
    white = float(np.std(sense - fit.value("phi_x"))) / 1e-4  # the noise as it was, beside the declared one
    scale = max(white**2, 1.0)
    data, prior = few / (1e-8 * scale), 1.0 / initial.deviation**2
    expected = (data * volts + prior * initial.value) / (data + prior)
    assert fit.value("phi_x") == pytest.approx(expected, abs=3e-7)
    assert at(fit, "phi_x")[1] == pytest.approx((data + prior) ** -0.5, rel=0.1)
    assert abs(expected - volts) > 3e-6


@pytest.mark.moderate
def test_a_sign_and_a_weight_of_what_is_declared_show() -> None:
    """Known to nothing it changes nothing; known exactly it stays."""
    drive = slow(2e4, 40.0)
    sense = record(drive)
    free = refine(OBSERVER, sense, drive)
    loose = refine(OBSERVER, sense, drive, known={"kxx": Declared(1.5e5, 1e9)})
    tight = refine(OBSERVER, sense, drive, known={"kxx": Declared(1.96e5, 1e-3)})
    assert loose.value("kxx") == pytest.approx(free.value("kxx"), rel=1e-7)
    assert tight.value("kxx") == pytest.approx(1.96e5, abs=0.01)


@pytest.mark.moderate
def test_what_is_declared_decides_where_the_record_does_not() -> None:
    """Far below the resonance a displacement tells gain over stiffness, neither of them."""
    drive = slow()
    sense = record(drive)
    known = declared(OBSERVER)
    fit = refine(OBSERVER, sense, drive, known=known)
    for name in ("kxx", "drive_gain_x"):
        value, deviation = at(fit, name)
        assert abs(value - known[name].value) < 1.5 * known[name].deviation
        # Their ratio is known, so that what is declared of one, 5 %, and of the other, 10 %, tells the same number.
        assert deviation / value == pytest.approx((0.05**-2 + 0.1**-2) ** -0.5, rel=0.1)
    ratio = fit.value("drive_gain_x") / fit.value("kxx")
    assert ratio == pytest.approx(TRUE["drive_gain_x"] / TRUE["kxx"], rel=1e-3)


@pytest.mark.moderate
def test_the_combination_that_is_determined_is_named() -> None:
    drive = slow()
    fit = refine(OBSERVER, record(drive), drive, known=declared(OBSERVER))
    (sentence,) = undetermined(fit)
    said, together = sentence.split("; it does determine ")
    assert said.startswith("the record does not determine ")
    assert {"kxx", "drive_gain_x"} <= set(said.partition("determine ")[2].partition(":")[0].replace(",", "").split())
    assert together.partition(",")[0] in ("kxx^−1 × drive_gain_x", "kxx × drive_gain_x^−1")


@pytest.mark.moderate
def test_a_record_that_determines_all_says_nothing() -> None:
    drive = 1e4 * np.random.default_rng(2).standard_normal((N, 1))
    fit = refine(OBSERVER, record(drive), drive, known=declared(OBSERVER))
    assert undetermined(fit) == ()
    for name, true in TRUE.items():
        value, deviation = at(fit, name)
        assert abs(value - true) < 4.0 * deviation


@pytest.mark.moderate
def test_a_free_decay_says_nothing_of_the_drive() -> None:
    drive = np.zeros((N, 1))
    fit = refine(OBSERVER, record(drive, x=0.05), drive, known=declared(OBSERVER))
    (sentence,) = undetermined(fit)
    assert sentence.startswith("the record does not determine drive_gain_x: it says less of it than the bench file")
    assert "it does determine" not in sentence
    assert at(fit, "drive_gain_x") == pytest.approx((1.0, 0.1), rel=1e-3)


@pytest.mark.moderate
def test_beside_a_residual_that_is_no_noise_what_is_declared_counts_for_more() -> None:
    """A disturbance that the model lacks, hundreds of times the noise, moves the stiffness within what is declared of
    it; by the number of samples and the declared noise alone it would move it as far as it can.
    """
    drive = slow(2e4)
    disturbance = lfilter([1.0], [1.0, -0.99], np.random.default_rng(5).standard_normal((N, 1)), axis=0)
    sense = record(drive, noise=NOISE + 40.0 * disturbance)
    known = declared(OBSERVER)
    alone, fit = (refine(OBSERVER, sense, drive, known=one) for one in (None, known))
    off = [abs(one.value("kxx") - known["kxx"].value) / known["kxx"].deviation for one in (alone, fit)]
    assert off[1] < 1.5 < 5.0 < off[0]


def test_declared_are_the_constants_of_the_base_model() -> None:
    known = declared(Observer(DEVICE, replace(OBSERVER.settings, effects={"cubic_stiffness": {}})))
    assert set(known) == {"phi_x", "kxx", "dxx", "drive_gain_x"}
    assert known["kxx"] == Declared(1.9e5, pytest.approx(0.05 * 1.9e5))
    assert known["dxx"] == Declared(40.0, pytest.approx(20.0))
    assert known["drive_gain_x"] == Declared(1.0, pytest.approx(0.1))


def found(information, **values):
    """What the record says of constants that are declared to a tenth of 10."""
    names = tuple(values)
    return SimpleNamespace(
        free=(*names, "x"), value=lambda name: values[name], information=np.array(information, float),
        known={name: Declared(10.0, 1.0) for name in names},
    )  # fmt: skip


def test_information_on_some_is_what_is_left_whatever_the_others_are() -> None:
    """Schur's complement, in units of what is declared."""
    random = np.random.default_rng(3).standard_normal((40, 4)) * np.array([1.0, 1e3, 1e-3, 5.0])
    information = random.T @ random
    fit = found(information, a=1.0, b=1.0, c=1.0)
    fit.known["b"] = Declared(1.0, 0.25)
    covariance = np.linalg.inv(information)
    for names, at in ((("a",), [0]), (("b", "c"), [1, 2]), (("c", "a"), [2, 0])):
        size = [fit.known[name].deviation for name in names]
        expected = np.linalg.inv(covariance[np.ix_(at, at)]) * np.outer(size, size)
        np.testing.assert_allclose(determined._own(fit, names), expected, rtol=1e-6)
    alone = found(np.array([[4.0]]), a=1.0)
    alone.free = ("a",)
    assert determined._own(alone, ("a",)) == pytest.approx(4.0)


@pytest.mark.parametrize(("size", "said"), [(0.99, True), (1.0, False), (1.01, False)])
def test_what_says_less_than_the_bench_file_does_not_determine(size, said) -> None:
    told = undetermined(found(np.diag([size, 9.0]), a=10.0))
    assert bool(told) is said
    if said:
        assert told == ("the record does not determine a: it says less of it than the bench file, whose value stands",)


def test_of_several_it_says_less_of_each_and_how_well_it_knows_their_product() -> None:
    """A direction along a · b² · c⁻¹ in relative changes, known to 1/40 of a's tenth."""
    powers = np.array([1.0, 2.0, -1.0]) / 10.0  # ln of the product by the constants, each of 10
    along = powers / np.linalg.norm(powers)
    information = np.zeros((4, 4))
    information[:3, :3] = 1600.0 * np.outer(along, along)
    information[3, 3] = 7.0
    fit = found(information, a=10.0, b=10.0, c=10.0)
    (told,) = undetermined(fit)
    known, together = told.split("; it does determine ")
    assert known == (
        "the record does not determine a, b and c: it says less of each than the bench file, whose value stands"
    )
    # In units of the largest power, b; of b alone a relative deviation of |∇ ln b²…|/40.
    sure = 1.959963984540054 * np.linalg.norm(powers / 2.0) / 40.0
    assert together == f"a^0.5 × b × c^−0.5, to ± {sure:.2g} of itself"


@pytest.mark.parametrize(("size", "said"), [(0.9, False), (1.1, True)])
def test_a_combination_is_known_where_the_record_says_more_of_it_than_the_bench_file(size, said) -> None:
    information = np.zeros((3, 3))
    information[:2, :2] = size / 2.0
    assert (determined._together(found(information, a=10.0, b=10.0), ("a", "b")) is not None) is said


def test_a_factor_of_hardly_any_power_and_one_that_is_nothing_are_left_out() -> None:
    along = np.array([1.0, 0.04, 0.0])
    information = np.zeros((4, 4))
    information[:3, :3] = 1e4 * np.outer(along, along)
    assert determined._together(found(information, a=10.0, b=10.0, c=10.0), ("a", "b", "c")) is None
    along = np.array([1.0, 0.06, 1.0])
    information[:3, :3] = 1e4 * np.outer(along, along)
    told = determined._together(found(information, a=10.0, b=10.0, c=10.0), ("a", "b", "c"))
    assert told is not None
    assert told.partition(",")[0] == "a × b^0.1 × c"
    zero = found(information, a=10.0, b=10.0, c=10.0)
    zero.known["a"] = Declared(0.0, 1.0)
    assert determined._together(zero, ("a", "b")) is None
