"""What is seen with a model: how it is scanned, what is serious, what bounds the rest."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import freqs
from scipy.stats import norm

from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings
from estimator.thresholds import THRESHOLDS
from estimator.trace import look
from estimator.trace.evidence import Evidence
from estimator.trace.fitting import is_lost
from estimator.trace.look import Look, look_at, scanned_with
from estimator.trace.problem import Problem
from tests.estimator.device import UNLIKE as DEVICE

N = 900
BENCH = ObserverSettings(memory=0.1, gain=Gain.STATIONARY, effects={"sense_gain": {"gy": 0.1}})
AMPLITUDE = np.array([0.089, 0.0445])


def item(name: str, gain: float) -> Evidence:
    return Evidence(name, gain, 1, 1.0, np.zeros(1), np.ones(1))


def model(share: float) -> Any:
    """Whose innovations are that share of the amplitude."""
    signs = np.where(np.arange(2 * N).reshape(N, 2) % 2, 1.0, -1.0)
    settings = ObserverSettings(memory=9.0, gain=Gain.FADING, effects={"sense_gain": {"gy": 0.2}, "drag": {"dqx": 3.0}})
    estimates = SimpleNamespace(innovation=share * AMPLITUDE * signs, innovation_deviation="sure of its own")
    return SimpleNamespace(settings=settings, estimates=estimates, observer="carrying")


@pytest.mark.filterwarnings("ignore:Mean of empty slice")
@pytest.mark.parametrize(("share", "lost"), [(0.029, False), (0.031, True), (np.nan, True)])
def test_the_motion_is_lost_from_three_percent_of_the_amplitude_on(share: float, *, lost: bool) -> None:
    assert is_lost(model(share).estimates.innovation, DEVICE) is lost


def test_what_follows_is_scanned_without_forgetting_and_what_does_not_with_the_memory_of_the_bench(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(look, "coefficients_of", lambda observer: {observer: {}})
    near = scanned_with(model(0.01), DEVICE, BENCH)
    assert (near.gain, near.memory, set(near.effects)) == (Gain.EKF, 9.0, {"sense_gain", "drag"})
    far = scanned_with(model(0.2), DEVICE, BENCH)
    assert (far.gain, far.memory, set(far.effects)) == (Gain.FADING, 0.1, {"carrying"})


def test_serious_is_what_chance_gives_none_of_so_many() -> None:
    """χ² of one coefficient, at 10⁻⁴ over four candidates: 17.9."""
    found = {name: item(name, gain) for name, gain in (("a", 25.0), ("b", 18.0), ("c", 17.7), ("d", 1.0))}
    scan: Any = None
    assert [one.name for one in Look({}, scan, found).serious] == ["a", "b"]


def test_what_is_as_significant_as_chance_makes_one_is_not_serious(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {name: item(name, gain) for name, gain in (("a", 25.0), ("b", 18.0))}
    asked: list[int] = []
    monkeypatch.setattr(look, "threshold", lambda number: asked.append(number) or found["b"].significance)
    scan: Any = None
    assert [one.name for one in Look({}, scan, found).serious] == ["a"]
    assert set(asked) == {2}


def test_who_is_alike_is_told_by_the_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    scan: Any = "what was seen"
    monkeypatch.setattr(look, "likeness", lambda seen, name: {"of": (seen, name)})
    assert Look({}, scan, {}).alike("drag") == {"of": (scan, "drag")}


def problem() -> Problem:
    record = Record(np.zeros((N, 2)), np.zeros((N, 2, 1)), np.full(N, 1 / 4000.0))
    return Problem(record, DEVICE, BENCH)


@pytest.mark.parametrize("lost", [False, True])
def test_lines_are_seen_in_what_the_model_left_and_all_that_is_not_carried_is_scanned_once(
    monkeypatch: pytest.MonkeyPatch, *, lost: bool
) -> None:
    """Where the motion was lost, the lines are those of a scan with the bench's memory."""
    scans, asked_about = [], []
    fitted = model(0.2 if lost else 0.01)

    def scan(asked: Problem, watched: Any, previous: Any, *, halves: bool = False) -> Any:
        assert halves is bool(watched)  # what is dear, nothing else runs beside it
        scans.append((asked.settings.gain, set(asked.effects), set(watched), previous))
        return SimpleNamespace(innovation="seen", deviation="sure", of=watched)

    def watch_list(record: Record, device: Device, innovation: Any, deviation: Any, asked: tuple[str, ...]) -> Any:
        asked_about.append((innovation, deviation))
        return {"drag": {}, "drive_gain": {}, "interference:1": {"omega": 5.0}}

    monkeypatch.setattr(look, "scan", scan)
    monkeypatch.setattr(look, "watch_list", watch_list)
    monkeypatch.setattr(look, "coefficients_of", lambda observer: fitted.settings.effects)
    monkeypatch.setattr(look, "evidence", lambda seen: {name: item(name, 1.0) for name in seen.of})
    found = look_at(problem(), fitted)
    carried = {"sense_gain", "drag"}
    everything = {"drive_gain", "interference:1"}
    if lost:
        assert asked_about == [("seen", "sure")]
        assert scans == [
            (Gain.FADING, carried, set(), "carrying"),
            (Gain.FADING, carried, everything, "carrying"),
        ]
    else:
        assert asked_about == [(fitted.estimates.innovation, "sure of its own")]
        assert scans == [(Gain.EKF, carried, everything, "carrying")]
    assert set(found.watched) == set(found.evidence) == everything


def test_bounds_are_of_what_is_watched_and_not_carried_with_constants_as_declared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scans = []

    # No earlier pass: the constants are as sure as declared.
    def scan(asked: Problem, watched: Any, *, halves: bool) -> Any:
        scans.append((set(asked.effects), watched))
        return SimpleNamespace(name="scanned", sound=True)

    monkeypatch.setattr(look, "scan", scan)
    monkeypatch.setattr(look, "evidence", lambda seen: {seen.name: item("drive_gain", 1.0)})
    assert set(look.bounds(problem(), model(0.01), {"drag": {}, "drive_gain": {"p": 1.0}})) == {"scanned"}
    assert scans == [({"sense_gain", "drag"}, {"drive_gain": {"p": 1.0}})]


def test_a_frequency_is_new_where_it_is_five_turns_from_those_that_are_carried() -> None:
    carried = {"interference": {"omega": 500.0}}
    for apart, is_new in ((2.9, False), (-2.9, False), (3.1, True), (-3.1, True)):
        fresh = look.fresh({"base_vibration": {"omega": 500.0 + apart}}, carried, span=10.0)
        assert bool(fresh) is is_new
    span = THRESHOLDS.scan.apart  # so that what is closer than one rad/s is the same
    assert look.fresh({"base_vibration": {"omega": 501.0}}, carried, span=span)
    assert not look.fresh({"base_vibration": {"omega": np.nextafter(501.0, 500.0)}}, carried, span=span)


@pytest.mark.parametrize("sound", [True, False])
def test_an_observer_that_diverges_bounds_nothing(monkeypatch: pytest.MonkeyPatch, *, sound: bool) -> None:
    monkeypatch.setattr(look, "coefficients_of", lambda observer: {})
    monkeypatch.setattr(look, "scan", lambda problem, watched, halves: SimpleNamespace(sound=sound))
    monkeypatch.setattr(look, "evidence", lambda seen: {"cubic_stiffness": item("cubic_stiffness", 1.0)})
    record = Record(np.zeros((N, 2)), np.zeros((N, 2, 1)), np.full(N, 2.5e-4))
    found = look.bounds(Problem(record, DEVICE, BENCH), model(0.01), {"cubic_stiffness": {}})
    assert (set(found) == {"cubic_stiffness"}) is sound


@pytest.mark.parametrize(("rate", "farthest"), [(4000.0, "nyquist"), (700.0, "resonance")])
def test_where_the_drive_has_one_frequency_the_bound_of_a_mode_holds_for_any(
    monkeypatch: pytest.MonkeyPatch, rate: float, farthest: str
) -> None:
    """By SciPy's response of a mode: none below half the sampling rate is seen as much at less, elsewhere than beside
    the resonance; at the farthest of them it is as much.
    """
    resonance, watched = np.sqrt(DEVICE.target), 2.5 * np.sqrt(DEVICE.target)
    rate *= resonance / (2.0 * np.pi * 250.0)
    seconds = np.arange(N * 8) / rate
    line = np.sin(resonance * seconds)
    drive = np.stack([line, 0.5 * line], axis=1)[:, :, None]
    record = Record(np.zeros((N * 8, 2)), drive, np.full(N * 8, 1.0 / rate))
    found = Evidence("parasitic_mode:1", 1.0, 2, 1.0, np.array([-0.02, 0.01]), np.array([0.01, 0.005]))
    monkeypatch.setattr(look, "scan", lambda problem, watched, halves: SimpleNamespace(sound=True))
    monkeypatch.setattr(look, "evidence", lambda seen: {found.name: found, "drag": item("drag", 1.0)})
    parameters = {found.name: {"omega": watched, "zeta": 1e-6}, "drag": {}}
    monkeypatch.setattr(look, "coefficients_of", lambda observer: {})
    bounds = look.bounds(Problem(record, DEVICE, BENCH), model(0.01), parameters)
    assert bounds["drag"].coefficients.tolist() == [0.0]
    mode = bounds[found.name]
    np.testing.assert_array_equal(mode.coefficients, 0.0)
    most = norm.ppf(0.975) * mode.deviation
    seen = (np.abs(found.coefficients) + norm.ppf(0.975) * found.deviation) * at(resonance, watched)
    nyquist = np.pi * rate
    others = [omega for omega in np.linspace(0.01 * resonance, 0.999 * nyquist, 97) if abs(omega / resonance - 1) > 0.1]
    as_seen = np.array([most * at(resonance, omega) for omega in others]) / seen
    assert np.min(as_seen) > 0.998
    assert np.min(as_seen[-1 if farthest == "nyquist" else 0]) == pytest.approx(1.0, abs=5e-3)
    with_dither = replace(record, drive=drive + np.random.default_rng(1).standard_normal(drive.shape))
    assert look.bounds(Problem(with_dither, DEVICE, BENCH), model(0.01), parameters)[found.name] is found


def at(frequency: float, omega: float) -> float:
    """Response of a mode of 1/s² at a frequency, rad/s."""
    _, response = freqs([1.0], [1.0, 2e-6 * omega, omega**2], worN=[frequency])
    return float(np.abs(response[0]))
