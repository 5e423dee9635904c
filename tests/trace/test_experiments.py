"""The experiment that is advised, and what is played through for it (docs/reference/trace.md, `separate_by`)."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, Spread
from estimator.trace import experiments
from estimator.trace.experiments import EXPERIMENTS, Experiment, Turn, loop_record, turn_for

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
BY_NAME = {experiment.name: experiment for experiment in EXPERIMENTS}


@pytest.mark.parametrize("wander", [0.01, 0.5])
def test_a_turn_is_as_far_as_the_rate_wanders_in_half_a_period(wander: float) -> None:
    """Three periods in the record."""
    turn = turn_for(2.0 * np.pi * HZ, wander, 24.0)
    assert turn.period == pytest.approx(8.0)
    assert 2.0 * turn.rate == pytest.approx(wander * np.sqrt(0.5 * turn.period))


def test_a_turn_is_no_faster_than_a_table_and_the_holds_allow() -> None:
    omega0 = 2.0 * np.pi * HZ
    turn = turn_for(omega0, 1e6, 0.01)
    assert turn.rate == pytest.approx(1e-3 * omega0)
    assert turn.period == pytest.approx(150.0 / HZ)
    assert turn_for(omega0, 0.0, 24.0).rate == 0.0


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
def test_an_experiment_holds_400_cycles_while_the_pattern_turns() -> None:
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
    assert Experiment("still", "do nothing") == Experiment("still", "do nothing", 0.0, 0.0, 0.0, 0.0, False)


def test_an_experiment_is_played_by_the_loop_that_it_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the units of the bench: forces of k A, the converter's code of the quieter channel's noise, rates of ω0."""
    omega0 = 2.0 * np.pi * HZ
    laws: list[ControllerSettings] = []
    device = replace(DEVICE, noise=(3e-4, 1e-4), drive_gain=2.0)
    made = experiments.Observer

    def observer(of: Device, settings: ObserverSettings, law: ControllerSettings) -> Any:
        laws.append(law)
        assert (settings.gain, settings.effects, settings.memory) == (Gain.EKF, {}, 0.1)
        return made(of, settings, law)

    seen: list[Any] = []

    def block(observer: Any, truth: Any, plan: Any, sensed: Any, drive: Any) -> None:
        seen.append((truth.copy(), plan))
        sensed[:] = 0.5, 2.0
        drive[:] = 0.25, -1.0

    monkeypatch.setattr(experiments, "Observer", observer)
    monkeypatch.setattr(experiments, "experiment_block", block)
    experiment = Experiment("any", "do it", virtual=2e-3, modulation=0.4, dither=3e-3, stiffness=0.02, turning=True)
    turn = Turn(5e-3 * omega0, 2.0 * np.pi * 130.0 / omega0)
    record = loop_record(experiment, device, SETTINGS, latency=4, turn=turn)
    force = 1e-4 * TARGET  # m/s², whatever unit the drive has
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
    np.testing.assert_allclose(plan.rates, 5e-3 * np.sin(phase / 130.0), atol=1e-9)
    np.testing.assert_allclose(plan.stiffness, 1.0 + 0.02 * np.sign(np.sin(phase / 120.0)), atol=1e-9)
    np.testing.assert_allclose(np.std(plan.noise, axis=0) * 1e-4 * np.array([890.0, 900.0]), device.noise, rtol=0.05)
    np.testing.assert_allclose(record.sense, [[-0.5 * 890.0 * 1e-4, 2.0 * 900.0 * 1e-4]] * len(n))
    np.testing.assert_allclose(record.drive[:, :, 0], [[0.25 * force / 2.0, -force / 2.0]] * len(n))
    np.testing.assert_array_equal(record.step, 1 / RATE)
