"""The Cramér–Rao bound against closed forms and against the information recursion written out in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.bound import posterior_bound
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.oracle.evaluation import evaluated
from estimator.oracle.flow import backward, flow
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant
from tests.estimator.gyro_loop import Array, Truth, close_loop, observer_of

SAMPLES = 2000  # 100 cycles of 20 samples
RATE = 4000.0
OMEGA = 2 * np.pi * 200.0
AMPLITUDE, GAIN, NOISE = 1e-4, -890.0, 2e-4
SNR = (AMPLITUDE * GAIN / NOISE) ** 2 / 2.0  # η of the closed forms


def sinusoid(phase: float) -> Array:
    """x and ẋ (SAMPLES, 2) of A cos(ωt + phase) at the samples."""
    psi = OMEGA * np.arange(SAMPLES) / RATE + phase
    return AMPLITUDE * np.stack([np.cos(psi), -OMEGA * np.sin(psi)], axis=1)


def test_frequency_amplitude_and_phase_of_a_sinusoid_in_white_noise() -> None:
    """Three unknowns, N samples, η = A²/2σ²: var ω = 12/(ηN(N²−1)) per sample², var φ = 2(2N−1)/(ηN(N+1)), var A =
    2σ²/N.

    S. M. Kay, Fundamentals of Statistical Signal Processing I, 1993, example 3.14; first D. C. Rife and R. R. Boorstyn,
    IEEE Trans. Information Theory 20(5), 1974.  The phase is that at the end of the record, by symmetry as at its
    start.
    """
    device = Device(
        sample_rate=RATE, stiffness=(OMEGA**2,), damping=(0.0,), amplitude=AMPLITUDE, sense_gain=(GAIN,), noise=(NOISE,)
    )
    spread = Spread(position=1e3, velocity=1e3, offset=0.0, stiffness=10.0, damping=0.0, drive_gain=0.0)
    motion = sinusoid(0.7)
    truth = np.column_stack([motion, np.tile([0.0, OMEGA**2, 0.0, 1.0], (SAMPLES, 1))])
    settings = ObserverSettings(spread=spread)
    bound = posterior_bound(device, settings, truth, np.zeros((SAMPLES, 1)), every=SAMPLES)
    n = SAMPLES
    frequency = bound.of("kxx")[-1] / (2 * OMEGA)
    assert frequency == pytest.approx(RATE * np.sqrt(12 / (SNR * n * (n**2 - 1))), rel=2e-3)
    # x = A cos ψ and ẋ = −ωA sin ψ give the other two back; where ψ makes them separate they can be read off.
    x, v = motion[-1] / AMPLITUDE
    var_amplitude, var_phase = 2 * (NOISE / GAIN) ** 2 / n, 2 * (2 * n - 1) / (SNR * n * (n + 1))
    expected_x = np.sqrt(x**2 * var_amplitude + (AMPLITUDE * v / OMEGA) ** 2 * var_phase)
    assert bound.of("x")[-1] == pytest.approx(expected_x, rel=5e-3)


def two_axes(rate: float, spread: Spread) -> tuple[Device, ObserverSettings, Array]:
    device = Device(
        sample_rate=RATE, stiffness=(OMEGA**2, OMEGA**2, 0.0), damping=(0.0,) * 3, amplitude=AMPLITUDE,
        sense_gain=(GAIN,) * 2, noise=(NOISE,) * 2,
    )  # fmt: skip
    truth = np.zeros((SAMPLES, 13))
    truth[:, :2] = sinusoid(0.4)
    truth[:, 6] = rate
    truth[:, 7:9] = OMEGA**2
    return device, ObserverSettings(variant=Variant.SENSE, spread=spread), truth


def test_pattern_angle_with_everything_else_known() -> None:
    """The angle is one quadrature of the sinusoid across the pattern, over A: var θ = 2σ²/(N A²)."""
    device, settings, truth = two_axes(0.0, Spread(position=1e3, velocity=1e3, offset=0.0, rate=0.0))
    bound = posterior_bound(device, settings, truth, np.zeros((SAMPLES, 2)), every=SAMPLES)
    assert bound.angle[-1] == pytest.approx(np.sqrt(1.0 / (SNR * SAMPLES)), rel=2e-3)


def test_rate_and_pattern_angle_are_a_straight_line_fit() -> None:
    """θ(t) = θ0 − Ωt in noise of 2σ²/A² a sample: var Ω = 12/(ηN(N²−1)) per sample², var θ at the end
    2(2N−1)/(ηN(N+1)).
    """
    device, settings, truth = two_axes(0.0, Spread(position=1e3, velocity=1e3, offset=0.0, rate=0.5 * OMEGA))
    bound = posterior_bound(device, settings, truth, np.zeros((SAMPLES, 2)), every=SAMPLES)
    n = SAMPLES
    assert bound.of("rate")[-1] == pytest.approx(RATE * np.sqrt(12 / (SNR * n * (n**2 - 1))), rel=2e-3)
    assert bound.angle[-1] == pytest.approx(np.sqrt(2 * (2 * n - 1) / (SNR * n * (n + 1))), rel=2e-3)


def information_recursion(observer: Observer, truth: Array, drive: Array, noise: float) -> Array:
    """Deviations (n, estimated), SI: J ← (F J⁻¹ Fᵀ + Q)⁻¹ + Hᵀ R⁻¹ H along the truth (n, 13), force noise [m/s²/√Hz]
    only.
    """
    device, model = observer.device, evaluated(observer.number)
    index, factors, states = observer.estimated_index, observer.factors, observer.states
    h = observer.h
    x = truth / factors
    u = drive / observer.scaling.drive
    q = np.zeros((len(index),) * 2)
    density = noise**2 / 2 / (device.amplitude**2 * observer.scaling.omega0**3)
    for axis in range(2):
        q[2 * axis : 2 * axis + 2, 2 * axis : 2 * axis + 2] = density * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
    r = np.diag((np.array(device.noise) / observer.scaling.sense(0)) ** 2)
    information = np.linalg.inv(observer.arrays.p)
    before = x[0].copy()
    before[:states] = backward(model, x[0, states:], x[0, :states], u[0][:, None], h)
    found = np.zeros((len(truth), len(index)))
    for m, state in enumerate([before, *x[:-1]]):
        _, transition, sensitivity = flow(model, state[states:], state[:states], u[m][:, None], h)
        f = np.eye(13)
        f[:states, :states], f[:states, 6:] = transition, sensitivity
        f = f[np.ix_(index, index)]
        jacobian = model.jacobian(x[m, :states], x[m, states:])[:, index]
        information = np.linalg.inv(f @ np.linalg.inv(information) @ f.T + q) + jacobian.T @ np.linalg.inv(r) @ jacobian
        found[m] = np.sqrt(np.diag(np.linalg.inv(information))) * np.abs(factors[index])
    return found


@pytest.mark.moderate
@pytest.mark.parametrize("variant", list(Variant))
def test_kernel_and_information_recursion_agree_on_a_closed_loop(variant: Variant) -> None:
    truth = Truth(force_noise=1e-5)
    record = close_loop(observer_of(truth, ObserverSettings()), truth, 300, 1.5, acquire=100)
    states = np.column_stack([
        record.motion, np.tile(truth.offset, (300, 1)), record.rate, np.tile(truth.parameters, (300, 1))
    ])  # fmt: skip
    settings = ObserverSettings(variant=variant, gain=Gain.EKF, process_noise=ProcessNoise(force=1e-5))
    device = truth.device()
    bound = posterior_bound(device, settings, states, record.drive)
    expected = information_recursion(Observer(device, settings), states, record.drive, 1e-5)
    index = Observer(device, settings).estimated_index
    np.testing.assert_allclose(bound.deviation[:, index], expected, rtol=1e-6)
    decimated = posterior_bound(device, settings, states, record.drive, every=7)
    np.testing.assert_allclose(decimated.deviation, bound.deviation[6::7], rtol=1e-12)
    np.testing.assert_allclose(decimated.angle, bound.angle[6::7], rtol=1e-12)


@pytest.mark.moderate
def test_an_effect_that_is_estimated_too_costs_certainty_about_the_rest() -> None:
    """The bound of a model that carries an effect: its coefficient has one, and no other bound gets smaller."""
    truth = Truth()
    record = close_loop(observer_of(truth, ObserverSettings()), truth, 400, 1.5, acquire=100)
    constants = np.tile([*truth.offset, 1.5, *truth.parameters], (400, 1))
    states = np.column_stack([record.motion, constants])
    base = posterior_bound(truth.device(), ObserverSettings(), states, record.drive, every=400)
    name = "cubic_stiffness"
    settings = ObserverSettings(effects={name: {}})
    extra = len(Observer(truth.device(), settings).names) - 13
    wider = np.column_stack([states, np.zeros((400, extra))])
    bound = posterior_bound(truth.device(), settings, wider, record.drive, every=400)
    assert np.all(bound.deviation[0, 13:] > 0.0)
    assert np.all(bound.deviation[0, :13] >= base.deviation[0] * (1.0 - 1e-9))
    assert bound.of("kxx")[0] > 1.5 * base.of("kxx")[0]


def test_lost_samples_carry_no_information() -> None:
    device, settings, truth = two_axes(1.0, Spread(rate=1.0))
    lost = np.zeros((SAMPLES, 2), dtype=bool)
    lost[1000:] = True
    bound = posterior_bound(device, settings, truth, np.zeros((SAMPLES, 2)), lost=lost, every=1000)
    assert bound.of("rate")[1] == pytest.approx(bound.of("rate")[0], rel=1e-9)
    assert bound.angle[1] > 1.5 * bound.angle[0]


def test_the_gain_asked_for_changes_no_bound() -> None:
    device, settings, truth = two_axes(1.0, Spread(rate=1.0))
    drive = np.zeros((SAMPLES, 2))
    fading, ekf = (
        posterior_bound(device, replace(settings, gain=gain), truth, drive, every=500)
        for gain in (Gain.FADING, Gain.EKF)
    )
    np.testing.assert_array_equal(fading.deviation, ekf.deviation)


def test_truth_of_another_shape_is_refused() -> None:
    device, settings, truth = two_axes(1.0, Spread())
    with pytest.raises(ModelError, match=r"truth has shape \(2000, 12\); 2000 rows of x, vx, y, vy, phi_x"):
        posterior_bound(device, settings, truth[:, :12], np.zeros((SAMPLES, 2)))
