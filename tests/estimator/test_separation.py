"""The experiment that is advised, and what is played through for it (docs/reference/trace.md, `separate_by`)."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.record import Record
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, Spread
from estimator.trace import separation
from estimator.trace.problem import Problem
from estimator.trace.separation import EXPERIMENTS, Experiment, loop_record, separations

RATE, HZ = 4000.0, 200.0
TARGET = (2.0 * np.pi * HZ) ** 2
DEVICE = Device(
    sample_rate=RATE,
    stiffness=(TARGET, TARGET, 0.0),
    damping=(8.0, 8.0, 0.0),
    amplitude=1e-4,
    sense_gain=(-890.0, 900.0),
    noise=(1e-4, 1e-4),
)
SETTINGS = ObserverSettings(effects={"drag": {"dqx": 1.0}}, memory=0.1, spread=Spread(stiffness=1e-3, damping=0.05))
CONTROLLER = ControllerSettings(latency=3, force_quantum=1e-3, force_limit=10.0, sense_quantum=1e-5)
BY_NAME = {experiment.name: experiment for experiment in EXPERIMENTS}


@pytest.fixture
def advised(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The advice for drive gain beside another, of likenesses by experiment, and what was asked."""

    def run(likenesses: dict[str, float], controller: ControllerSettings | None = CONTROLLER) -> Any:
        asked = SimpleNamespace(latency=set(), coefficients=[], watched=[], told=[])

        def play(experiment: Any, device: Device, settings: ObserverSettings, *, latency: int) -> Any:
            asked.latency.add(latency)
            asked.settings = settings
            return SimpleNamespace(name=experiment.name, sense=np.zeros((9, 2)))

        def scan(problem: Problem, watched: Any) -> Any:
            asked.watched.append(watched)
            return SimpleNamespace(
                of=problem.record, columns={"drive_gain": slice(0, 2), "drive_saturation": slice(2, 4)}
            )

        def likeness(seen: Any, name: str, coefficients: Any) -> dict[str, float]:
            asked.coefficients.append((name, None if coefficients is None else coefficients.tolist()))
            alike = likenesses[seen.of.name]
            return {} if np.isnan(alike) else dict.fromkeys(("drive_gain", "drive_saturation"), alike)

        monkeypatch.setattr(separation, "loop_record", play)
        monkeypatch.setattr(separation, "scan", scan)
        monkeypatch.setattr(separation, "likeness", likeness)
        looks = ({"drive_gain": {}}, {"drive_gain": {"late": 1.0}, "drive_saturation": {"limit": 2.0}})
        selection: Any = SimpleNamespace(
            effects={"drive_saturation": {"sx": 0.3, "sy": 0.4, "limit": 2.0}},
            rounds=[SimpleNamespace(look=SimpleNamespace(watched=watched)) for watched in looks],
            before=SimpleNamespace(settings=ObserverSettings(initial={"kxx": 7.0})),
        )
        record = Record(np.zeros((9, 2)), np.zeros((9, 2, 1)), np.full(9, 1 / RATE))
        pairs = [("drive_saturation", "drive_gain"), ("drive_gain", "drive_saturation")]
        problem = Problem(record, DEVICE, SETTINGS, controller)
        return separations(pairs, selection, problem, lambda *what: asked.told.append(what)), asked

    return run


LIKE = dict.fromkeys(BY_NAME, 0.9999)


def test_the_experiment_is_the_one_in_which_they_are_least_alike(advised: Any) -> None:
    found, _ = advised(LIKE | {"amplitude": 0.5, "dither": 0.4, "rate": 0.6})
    assert found == [(BY_NAME["dither"], 0.4)] * 2


@pytest.mark.parametrize(("all_at_once", "told"), [(0.4995, "dither"), (0.4985, "all")])
def test_all_at_once_must_tell_more_than_one_alone_by_a_thousandth(advised: Any, all_at_once: float, told: str) -> None:
    (first, _), _ = advised(LIKE | {"dither": 0.5, "all": all_at_once})
    assert first[0] == BY_NAME[told]


@pytest.mark.parametrize(("likeness", "separates"), [(0.9993, False), (0.9991, True)])
def test_where_no_experiment_separates_them_none_is_advised(advised: Any, likeness: float, separates: bool) -> None:
    (first, _), _ = advised(dict.fromkeys(BY_NAME, likeness))
    assert (first != (None, None)) is separates


def test_an_experiment_that_cannot_be_followed_tells_nothing(advised: Any) -> None:
    """Where its observer diverges, there is no likeness: NaN here."""
    found, _ = advised(dict.fromkeys(BY_NAME, float("nan")))
    assert found == [(None, None)] * 2
    found, _ = advised(dict.fromkeys(BY_NAME, float("nan")) | {"rate": 0.5})
    assert found == [(BY_NAME["rate"], 0.5)] * 2


@pytest.mark.moderate
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_where_the_model_is_no_oscillator_any_more_what_is_declared_is_played(sign: float) -> None:
    """Constants as a large lag in the sense chain has left them: a spring that pushes, damping as large as ω0."""
    left = {"rate": -500.0, "kxx": TARGET, "kyy": sign * TARGET, "kxy": -1.2 * TARGET, "dxx": -250.0, "dyy": 300.0}
    gains = {"drive_gain": {"gx": 0.05, "gy": 0.0}}
    selection: Any = SimpleNamespace(
        effects=gains,
        rounds=[SimpleNamespace(look=SimpleNamespace(watched={"drive_gain": {}, "sense_gain": {}}))],
        before=SimpleNamespace(settings=ObserverSettings(initial=left)),
    )
    record = Record(np.zeros((9, 2)), np.zeros((9, 2, 1)), np.full(9, 1 / RATE))
    problem = Problem(record, DEVICE, SETTINGS, CONTROLLER)
    pairs = [("drive_gain", "sense_gain")]
    with np.errstate(all="ignore"):
        ((experiment, expected),) = separations(pairs, selection, problem, lambda *what: None)
    selection.before.settings = ObserverSettings(initial={})
    assert [(experiment, expected)] == separations(pairs, selection, problem, lambda *what: None)
    assert experiment is not None


def test_experiments_are_played_with_the_model_as_it_was_before_and_the_benchs_latency(advised: Any) -> None:
    _, asked = advised(LIKE)
    assert asked.latency == {3}
    assert (asked.settings.gain, asked.settings.effects, asked.settings.initial) == (Gain.EKF, {}, {"kxx": 7.0})
    assert all(watched == {"drive_saturation": {"limit": 2.0}, "drive_gain": {}} for watched in asked.watched)
    assert asked.coefficients[:2] == [("drive_saturation", [0.3, 0.4]), ("drive_gain", None)]
    assert asked.told[-1] == ("experiments", 6, 6)
    _, asked = advised(LIKE, None)
    assert asked.latency == {1}


def test_a_single_axis_has_no_experiment_and_no_pair_no_advice() -> None:
    single = Device(
        sample_rate=RATE, stiffness=(1.6e6,), damping=(1.0,), amplitude=1e-4, sense_gain=(-890.0,), noise=(1e-4,)
    )
    record = Record(np.zeros((9, 1)), np.zeros((9, 1, 1)), np.full(9, 1 / RATE))
    selection: Any = None
    assert separations([("a", "b")] * 2, selection, Problem(record, single, SETTINGS), print) == [(None, None)] * 2
    assert separations([], selection, Problem(record, DEVICE, SETTINGS), print) == []


# -- what is played through ------------------------------------------------------------------------------------------


CYCLE = round(RATE / HZ)


def played(name: str, noise: float = 0.0) -> Any:
    """Record, displacements (n, 2) in amplitudes and drive (n, 2) in k A."""
    record = loop_record(BY_NAME[name], DEVICE, SETTINGS, latency=1, noise=noise)
    volts = np.array(DEVICE.sense_gain) * DEVICE.amplitude
    return record, record.sense / volts, record.drive[:, :, 0] / (TARGET * DEVICE.amplitude)


def sizes(motion: Any) -> Any:
    """The longest half axis of each cycle."""
    cycles = motion[: len(motion) // CYCLE * CYCLE].reshape(-1, CYCLE, 2)
    return np.sqrt(2.0 / CYCLE * np.linalg.norm(cycles, ord=2, axis=(1, 2)) ** 2)


def orientation(motion: Any) -> Any:
    """Of each cycle's longest axis, rad, followed over the turns."""
    cycles = motion[: len(motion) // CYCLE * CYCLE].reshape(-1, CYCLE, 2)
    x2, y2, xy = (np.sum(cycles[:, :, a] * cycles[:, :, b], axis=1) for a, b in ((0, 0), (1, 1), (0, 1)))
    return np.unwrap(np.arctan2(2.0 * xy, x2 - y2)) / 2.0


@pytest.mark.moderate
def test_an_experiment_is_400_cycles_at_a_held_amplitude_while_the_pattern_turns() -> None:
    record, motion, drive = played("virtual_rotation")
    assert len(record) == 400 * CYCLE
    np.testing.assert_array_equal(record.step, 1 / RATE)
    assert record.drive.shape == (400 * CYCLE, 2, 1)
    assert sizes(motion)[20:] == pytest.approx(1.0, abs=0.03)
    turned = orientation(motion)
    assert abs(turned[-1] - turned[100]) == pytest.approx(2e-3 * 2.0 * np.pi * 299, rel=0.1)
    assert np.max(np.abs(drive)) < 0.2  # nothing but damping is to be overcome


@pytest.mark.moderate
def test_the_amplitude_is_modulated_by_30_percent() -> None:
    held = sizes(played("amplitude")[1])[60:]
    assert np.max(held) == pytest.approx(1.3, abs=0.06)
    assert np.min(held) == pytest.approx(0.7, abs=0.06)


@pytest.mark.moderate
def test_a_dither_is_a_drive_off_the_resonance() -> None:
    usual, dithered = (np.abs(np.fft.rfft(played(name)[2][:, 0])) for name in ("virtual_rotation", "dither"))
    bins = np.arange(len(usual)) / len(usual)
    off = np.abs(bins - HZ / (RATE / 2.0)) > 0.02
    assert np.max(np.abs(played("dither")[2])) > BY_NAME["dither"].dither  # in k A
    assert np.sum(dithered[off] ** 2) > 10.0 * np.sum(usual[off] ** 2)


@pytest.mark.moderate
def test_the_stiffness_steps_by_two_percent_to_either_side() -> None:
    """±2 % of the square of the frequency, for 60 cycles each; seen where the motion crosses zero."""
    _, motion, _ = played("stiffness")
    along = motion[:, 0]
    rising = np.flatnonzero((along[:-1] < 0.0) & (along[1:] >= 0.0))
    crossings = rising - along[rising] / (along[rising + 1] - along[rising])
    fast = (crossings > 5 * CYCLE) & (crossings < 55 * CYCLE)
    slow = (crossings > 65 * CYCLE) & (crossings < 110 * CYCLE)
    usual, stepped = (np.mean(np.diff(crossings[part])) for part in (slow, fast))
    assert (usual / stepped) ** 2 == pytest.approx(1.02 / 0.98, rel=2e-3)


@pytest.mark.moderate
def test_a_rate_that_swings_turns_the_pattern_against_it() -> None:
    """Beside the same without it: by a share of −∫Ω dt = 0.15 (cos(ω0 t / 150) − 1), as the case turns under it."""
    usual, turned = (orientation(played(name)[1]) for name in ("virtual_rotation", "rate"))
    t = np.arange(len(usual)) * 2.0 * np.pi
    waves = np.stack([np.ones_like(t), t, np.cos(t / 150.0), np.sin(t / 150.0)], axis=1)
    _, _, against, beside = np.linalg.lstsq(waves, turned - usual, rcond=None)[0]
    assert against > 0.05
    assert np.hypot(against, beside) < 0.15


@pytest.mark.moderate
def test_noise_is_that_of_the_device_times_what_is_asked() -> None:
    """Told far above the resonance, where nothing moves."""
    usual, loud = (played("virtual_rotation", noise)[0].sense for noise in (1.0, 3.0))
    window = np.hanning(len(usual))[:, None]
    one, three = (
        np.sqrt(np.mean(np.abs(np.fft.rfft(window * sense, axis=0)[-2000:]) ** 2, axis=0) / np.sum(window**2))
        for sense in (usual, loud)
    )
    assert one == pytest.approx(np.array(DEVICE.noise), rel=0.1)
    assert three == pytest.approx(3.0 * one, rel=0.1)
    np.testing.assert_array_equal(usual, played("virtual_rotation", 1.0)[0].sense)  # the same each time


def test_an_experiment_does_nothing_but_what_it_says() -> None:
    assert Experiment("still", "do nothing") == Experiment("still", "do nothing", 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("constants", "holds"),
    [
        ({"kxx": 4.0, "kyy": 9.0, "kxy": 5.9}, True),
        ({"kxx": 4.0, "kyy": 9.0, "kxy": -5.9}, True),
        ({"kxx": 4.0, "kyy": 9.0, "kxy": 6.0}, False),  # along one direction nothing holds it
        ({"kxx": 4.0, "kyy": 9.0, "kxy": -6.1}, False),
        ({"kxx": 0.5, "kyy": 0.5, "kxy": 0.6}, False),
        ({"kxx": -4.0, "kyy": -9.0, "kxy": 0.0}, False),
        ({"kxx": 0.0, "kyy": 9.0, "kxy": 0.0}, False),
        ({"kxy": 0.9 * TARGET, "rate": 5.0}, True),  # beside the declared springs
        ({"kxy": 1.1 * TARGET}, False),
    ],
)
def test_springs_hold_a_mass_in_every_direction_or_it_does_not_oscillate(
    constants: dict[str, float], holds: bool
) -> None:
    assert separation._oscillates(constants, DEVICE) is holds


def test_an_experiment_is_played_by_the_loop_that_it_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the units of the bench: forces of k A, the converter's code of the quieter channel's noise, rates of ω0."""
    omega0 = 2.0 * np.pi * HZ
    laws: list[ControllerSettings] = []
    device = replace(DEVICE, noise=(3e-4, 1e-4), drive_gain=2.0)
    made = separation.Observer

    def observer(of: Device, settings: ObserverSettings, law: ControllerSettings) -> Any:
        laws.append(law)
        assert (settings.gain, settings.effects, settings.memory) == (Gain.EKF, {}, 0.1)
        return made(of, settings, law)

    seen: list[Any] = []

    def block(observer: Any, truth: Any, plan: Any, sensed: Any, drive: Any) -> None:
        seen.append((truth.copy(), plan))
        sensed[:] = 0.5, 2.0
        drive[:] = 0.25, -1.0

    monkeypatch.setattr(separation, "Observer", observer)
    monkeypatch.setattr(separation, "experiment_block", block)
    experiment = Experiment("any", "do it", virtual=2e-3, modulation=0.4, dither=3e-3, turning=5e-3, stiffness=0.02)
    record = loop_record(experiment, device, SETTINGS, latency=4)
    force = 1e-4 * TARGET / 2.0
    (law,) = laws
    assert law.latency == 4
    assert (law.force_quantum, law.force_limit) == (pytest.approx(1e-6 * force), pytest.approx(10.0 * force))
    assert law.sense_quantum == pytest.approx(1e-5)
    assert (law.energy_gain, law.quadrature_gain) == (0.1, 0.1)
    assert law.virtual_rotation == pytest.approx(2e-3 * omega0)
    assert law.dither == pytest.approx(3e-3 * force)
    assert (law.modulation, law.modulation_rate) == (0.4, pytest.approx(omega0 / 200.0))
    ((truth, plan),) = seen
    assert truth[:4].tolist() == [1.0, 0.0, 0.0, 0.0]
    cycle = RATE / HZ
    n = np.arange(int(400 * cycle))
    phase = 2.0 * np.pi * n / cycle
    np.testing.assert_allclose(plan.rates, 5e-3 * np.sin(phase / 150.0), atol=1e-9)
    np.testing.assert_allclose(plan.stiffness, 1.0 + 0.02 * np.sign(np.sin(phase / 120.0)), atol=1e-9)
    np.testing.assert_allclose(np.std(plan.noise, axis=0) * 1e-4 * np.array([890.0, 900.0]), device.noise, rtol=0.05)
    np.testing.assert_allclose(record.sense, [[-0.5 * 890.0 * 1e-4, 2.0 * 900.0 * 1e-4]] * len(n))
    np.testing.assert_allclose(record.drive[:, :, 0], [[0.25 * force, -force]] * len(n))
    np.testing.assert_array_equal(record.step, 1 / RATE)
