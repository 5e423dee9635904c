"""The observers of TW I384198 B1, each with each gain: 7 states, 11, 13 × stationary, EKF, EKF with fading memory."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant
from tests.estimator.gyro_loop import Truth, close_loop, observer_of, slope

BOARD = Truth()
NO_OFFSET = replace(BOARD, offset=(0.0, 0.0))
RATE = 1e-3 * BOARD.omega0
SPREAD = Spread(offset=0.01)


def of(variant: Variant, gain: Gain) -> tuple[Truth, Observer]:
    """A board that the variant's assumptions hold for, and its observer with the initial values that they allow."""
    truth = NO_OFFSET if variant is Variant.GYRO else BOARD
    spread = replace(SPREAD, offset=0.0) if variant is Variant.GYRO else SPREAD
    settings = ObserverSettings(variant=variant, gain=gain, memory=0.1, spread=spread)
    if variant is Variant.SENSE:
        return truth, observer_of(truth, settings, stiffness=1.0, damping=1.0)
    return truth, observer_of(truth, settings)


@pytest.mark.parametrize(("variant", "states"), [(Variant.SENSE, 7), (Variant.GYRO, 11), (Variant.FULL, 13)])
def test_each_variant_estimates_its_states(variant: Variant, states: int) -> None:
    _, observer = of(variant, Gain.EKF)
    assert len(observer.estimated) == states == len(observer.covariance)
    assert ("phi_x" in observer.estimated) == (variant is not Variant.GYRO)
    assert ("kxx" in observer.estimated) == (variant is not Variant.SENSE)


@pytest.mark.beyond(3)
@pytest.mark.slow
@pytest.mark.parametrize("gain", list(Gain))
@pytest.mark.parametrize("variant", list(Variant))
def test_angle_rate_and_parameters_are_right(variant: Variant, gain: Gain) -> None:
    truth, observer = of(variant, gain)
    known = observer.state[7:].copy()
    record = close_loop(observer, truth, 10_000, RATE)
    settled = 4000
    assert slope(record, record.angle, settled) == pytest.approx(1.0, abs=2e-3)
    assert slope(record, record.angle_rate_integral, settled) == pytest.approx(1.0, abs=2e-3)
    assert record.energy[settled:] == pytest.approx(1.0, abs=4e-3)
    assert np.std(record.ratio[settled:]) == pytest.approx(1.0, abs=0.03)
    constants = record.x[-1, 7:]
    if variant is Variant.SENSE:
        np.testing.assert_array_equal(constants, known)
    else:
        np.testing.assert_allclose(constants[:2], truth.parameters[:2], rtol=2e-5)
        assert constants[2] == pytest.approx(truth.parameters[2], abs=1e-5 * truth.omega0**2)
        np.testing.assert_allclose(constants[3:], truth.parameters[3:], atol=0.05e-3 * truth.omega0)
    if variant is Variant.GYRO:
        assert not np.any(record.x[:, 4:6])
    else:
        np.testing.assert_allclose(record.x[-1, 4:6], truth.offset, atol=0.1 * truth.noise)


@pytest.mark.moderate
@pytest.mark.parametrize("gain", list(Gain))
def test_seven_states_need_no_drive(gain: Gain) -> None:
    """A ring-down of a mismatched device: its pattern goes its own way, ∫Ω̂ dt is the angle."""
    settings = ObserverSettings(variant=Variant.SENSE, gain=gain, memory=0.1, spread=SPREAD)
    observer = observer_of(BOARD, settings, stiffness=1.0, damping=1.0)
    record = close_loop(observer, BOARD, 8000, np.pi / 2, acquire=8001)
    assert not np.any(record.drive)
    assert record.energy[-1] < 0.2
    error = (record.angle_rate_integral - record.turned)[800:]
    assert np.ptp(error) < 8e-3
    assert np.ptp((record.angle_pattern - record.turned)[800:]) > 0.5


@pytest.mark.moderate
def test_seven_states_follow_a_changing_rate() -> None:
    """Fading memory alone lags by its length; with the rate declared to wander the EKF follows."""
    rate = 2.0 * np.sin(2 * np.pi * 2.0 * np.arange(8001) / BOARD.sample_rate)
    settings = ObserverSettings(
        variant=Variant.SENSE, gain=Gain.EKF, spread=SPREAD, process_noise=ProcessNoise(rate=10.0)
    )
    observer = observer_of(BOARD, settings, stiffness=1.0, damping=1.0)
    record = close_loop(observer, BOARD, 8000, rate, acquire=8001)
    error = (record.angle_rate_integral - record.turned)[800:]
    assert np.ptp(record.turned) > 0.3
    assert np.ptp(error) < 0.03
    assert np.std((record.x[:, 6] - record.rate)[800:]) < 0.4


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize(("spread", "energy"), [(0.0, 0.15), (0.01, 0.01)])
def test_the_innovation_betrays_eleven_states_on_a_board_with_offsets(spread: float, energy: float) -> None:
    """What the full observer is for (claim 12): the loop stays up, but the ratio of innovation to prediction tells."""
    truth = replace(BOARD, offset=(0.01 * 0.089, -0.01 * 0.089))
    settings = ObserverSettings(variant=Variant.GYRO, memory=0.5, spread=replace(SPREAD, offset=spread))
    record = close_loop(observer_of(truth, settings), truth, 20_000, RATE)
    settled = record.x[6000:]
    assert np.all(np.isfinite(settled))
    assert record.energy[6000:] == pytest.approx(1.0, abs=energy)
    assert np.sqrt(np.mean(record.ratio[6000:] ** 2)) > 1.5
    full_settings = replace(settings, variant=Variant.FULL, spread=SPREAD)
    full = close_loop(observer_of(truth, full_settings), truth, 20_000, RATE)
    assert np.sqrt(np.mean(full.ratio[6000:] ** 2)) < 1.05


def test_parameters_come_normalised_by_the_mass_in_si() -> None:
    """State and covariance are 1/s² and 1/s; times the mass they are N/m and N·s/m, which the report may choose."""
    device = BOARD.device()
    observer = Observer(device, ObserverSettings(gain=Gain.EKF, spread=SPREAD))
    np.testing.assert_allclose(observer.state[7:], BOARD.parameters)
    deviation = np.sqrt(np.diag(observer.covariance))
    mean_damping = np.mean(BOARD.parameters[3:5])
    np.testing.assert_allclose(deviation[7:10], 0.05 * BOARD.omega0**2)
    np.testing.assert_allclose(deviation[10:], mean_damping)
    state, sd = observer.reading()
    np.testing.assert_allclose(state, observer.state)
    np.testing.assert_allclose(sd, deviation)


def test_initial_spread_is_in_si_whatever_the_gains_of_the_axes() -> None:
    device = BOARD.device(sense_gain=(-890.0, 1780.0))
    spread = Spread(offset=0.02, rate=3.0, stiffness=0.1, damping=0.5)
    deviation = np.sqrt(np.diag(Observer(device, ObserverSettings(spread=spread)).covariance))
    np.testing.assert_allclose(deviation[:4], BOARD.amplitude * np.array([1.0, BOARD.omega0] * 2))
    np.testing.assert_allclose(deviation[4:7], [0.02, 0.02, 3.0])


def test_random_walks_are_in_si_whatever_the_gains_of_the_axes() -> None:
    """After t seconds without a sample each variance has grown by the declared random walk squared times t."""
    device = BOARD.device(sense_gain=(-890.0, 1780.0))
    random_walk = ProcessNoise(rate=2.0, offset=0.003, stiffness=0.01, damping=0.5)
    settings = ObserverSettings(gain=Gain.EKF, spread=SPREAD, process_noise=random_walk)
    observer = Observer(device, settings)
    before = np.diag(observer.covariance).copy()
    seconds = 0.05
    observer.run(np.full((200, 2), np.nan), np.zeros((200, 2)))
    grown = np.sqrt((np.diag(observer.covariance) - before)[4:] / seconds)
    mean_damping = np.mean(BOARD.parameters[3:5])
    expected = [0.003, 0.003, 2.0, *[0.01 * BOARD.omega0**2] * 3, *[0.5 * mean_damping] * 3]
    np.testing.assert_allclose(grown, expected, rtol=1e-6)


def test_force_noise_is_a_one_sided_density() -> None:
    """a² [(m/s²)²/Hz] one-sided moves a free mass's velocity by a²/2 per second."""
    device = replace(BOARD.device(), stiffness=(1e-6, 1e-6, 0.0), damping=(1e-9, 1e-9, 0.0))
    settings = ObserverSettings(
        variant=Variant.SENSE,
        gain=Gain.EKF,
        spread=Spread(1e-9, 1e-9, 0.0, 0.0),
        process_noise=ProcessNoise(force=0.02),
    )
    observer = Observer(device, settings)
    observer.run(np.full((400, 2), np.nan), np.zeros((400, 2)))
    assert np.sqrt(observer.covariance[1, 1]) == pytest.approx(0.02 * np.sqrt(0.1 / 2), rel=1e-3)


@pytest.mark.moderate
def test_a_single_axis_estimates_its_drive_gain() -> None:
    """An oscillator driven in newtons by noise: stiffness, damping, offset and the gain from force to acceleration."""
    k, d, gain, mass = (2 * np.pi * 70.0) ** 2, 25.0, 1.0 / 0.3, 0.3
    rng = np.random.default_rng(11)
    device = Device(
        sample_rate=1000.0, stiffness=(k * 0.97,), damping=(d * 1.5,), amplitude=1e-2, sense_gain=(5.0,), noise=(1e-4,),
        drive_gain=1.1 / mass,
    )  # fmt: skip
    force = rng.standard_normal((6000, 1)) * 20.0
    truth = Observer(
        replace(device, stiffness=(k,), damping=(d,), drive_gain=gain), ObserverSettings(initial={"phi_x": 0.01})
    )
    sense = truth.run(np.full((6000, 1), np.nan), force).of("x")[:, None] * 5.0 + 0.01
    sense += rng.standard_normal(sense.shape) * 1e-4
    observer = Observer(device, ObserverSettings(gain=Gain.EKF, spread=Spread(offset=0.05, drive_gain=0.2)))
    found = observer.run(sense, force)
    error = (found.state[-1, 2:] - [0.01, k, d, gain]) / found.deviation[-1, 2:]
    assert np.max(np.abs(error)) < 4.0
    np.testing.assert_allclose(found.state[-1, 3:], [k, d, gain], rtol=2e-3)
    assert np.std((found.innovation / found.innovation_deviation)[500:]) == pytest.approx(1.0, abs=0.04)


CONTROLLER = ControllerSettings(latency=1, force_quantum=1e-3, force_limit=10.0, sense_quantum=1e-5)
SINGLE = Device(
    sample_rate=4000.0, stiffness=(1.6e6,), damping=(1.0,), amplitude=1e-4, sense_gain=(-890.0,), noise=(1e-4,)
)


def test_what_makes_no_observer_is_refused_in_one_line() -> None:
    device = BOARD.device()
    with pytest.raises(ModelError, match=r"memory must be positive, got 0.0 s"):
        ObserverSettings(memory=0.0)
    with pytest.raises(ModelError, match="no state or constant named kzz; known: x, vx"):
        Observer(device, ObserverSettings(initial={"kzz": 1.0}))
    for latency in (-1, 16):
        with pytest.raises(ModelError, match=f"drive latency of {latency} samples; 0 to 15 are supported"):
            Observer(device, ObserverSettings(), replace(CONTROLLER, latency=latency))
    with pytest.raises(ModelError, match="needs two axes, the device has 1"):
        Observer(SINGLE, ObserverSettings(), CONTROLLER)
    with pytest.raises(ModelError, match="a stationary gain is scheduled by the pattern angle and needs two axes"):
        Observer(SINGLE, ObserverSettings(gain=Gain.STATIONARY))


@pytest.mark.parametrize("name", ["drive", "step", "truth"])
def test_arrays_of_unequal_length_are_refused(name: str) -> None:
    arrays = {"drive": np.zeros((4, 2)), "step": np.full(4, 1e-4), "truth": np.zeros((4, 13))}
    arrays[name] = np.repeat(arrays[name], 2, axis=0)
    with pytest.raises(ModelError, match=f"{name} has 8 rows, sense has 4"):
        Observer(BOARD.device(), ObserverSettings()).run(np.zeros((4, 2)), **arrays)
