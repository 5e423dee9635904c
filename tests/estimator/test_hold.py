"""What the drive did between its samples, against an integrator that is given the continuous drive."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from estimator.errors import ModelError
from estimator.hold import Hold, drive_polynomials
from estimator.observer import Observer
from estimator.settings import Device, ObserverSettings
from tests.estimator.gyro_loop import Array

OVERSAMPLED = 16


def bandlimited_noise(band: float, samples: int, seed: int) -> Array:
    """White noise of unit rms below `band` of half the sampling rate, oversampled, cut from the middle of a longer
    one.
    """
    rng = np.random.default_rng(seed)
    length = 4 * samples * OVERSAMPLED
    spectrum = np.fft.rfft(rng.standard_normal(length))
    spectrum[np.fft.rfftfreq(length) * 2 * OVERSAMPLED > band] = 0.0
    noise = np.fft.irfft(spectrum, length)
    return noise[samples * OVERSAMPLED :][: samples * OVERSAMPLED] / np.std(noise)


@pytest.mark.parametrize(("band", "inside", "beside"), [(0.3, 4e-5, 4e-5), (0.66, 5e-5, 5e-5), (0.8, 2e-4, 2e-3)])
def test_bandlimited_pieces_follow_the_signal_between_its_samples(band: float, inside: float, beside: float) -> None:
    """The errors that the docstring states, the record's ends included; a mean is none."""
    dense = bandlimited_noise(band, 1500, seed=1) + 3.0
    u = dense[::OVERSAMPLED]
    pieces = drive_polynomials(u[:, None], "bandlimited")[:, 0]
    tau = np.arange(OVERSAMPLED) / OVERSAMPLED
    between = np.polynomial.polynomial.polyval(tau, pieces[1:].T)
    error = np.max(np.abs(between - dense[: len(between.ravel())].reshape(between.shape)), axis=1)
    assert np.max(error[3:-3]) < inside
    assert np.max(error) < beside


@pytest.mark.moderate
def test_pieces_join_without_a_step_in_value_and_three_derivatives() -> None:
    u = bandlimited_noise(0.8, 200, seed=2)[::OVERSAMPLED, None]
    pieces = [np.polynomial.Polynomial(c) for c in drive_polynomials(u, "bandlimited")[:, 0]]
    for left, right in itertools.pairwise(pieces):
        for order in range(4):
            a, b = (p.deriv(order) if order else p for p in (left, right))
            assert a(1.0) == pytest.approx(b(0.0), abs=1e-9)


def test_held_and_straight_pieces() -> None:
    u = np.array([[1.0, -1.0], [3.0, 0.0], [2.0, 5.0]])
    np.testing.assert_array_equal(drive_polynomials(u, "zoh"), u[:, :, None])
    expected = [[[1.0, 0.0], [-1.0, 0.0]], [[1.0, 2.0], [-1.0, 1.0]], [[3.0, -1.0], [0.0, 5.0]]]
    np.testing.assert_array_equal(drive_polynomials(u, "foh"), expected)


@pytest.mark.moderate
@given(st.integers(1, 12), st.floats(-1e6, 1e6))
def test_short_and_constant_records_stay_what_they_are(samples: int, value: float) -> None:
    found = drive_polynomials(np.full((samples, 2), value), "bandlimited")
    assert found.shape == (samples, 2, 8)
    tau = np.linspace(0.0, 1.0, 5)
    between = np.polynomial.polynomial.polyval(tau, found.reshape(-1, 8).T)
    np.testing.assert_allclose(between, value, rtol=1e-12, atol=1e-12)


@pytest.mark.moderate
@pytest.mark.parametrize(("hold", "limit"), [("bandlimited", 1e-6), ("foh", 0.2), ("zoh", 1.0)])
def test_an_oscillator_is_where_the_integrator_puts_it(hold: Hold, limit: float) -> None:
    """Driven by a multisine of up to 60 % of half the sampling rate; the flow between samples against solve_ivp."""
    device = Device(
        sample_rate=610.0, stiffness=(1.8e5,), damping=(30.0,), amplitude=0.1, sense_gain=(1.0,), noise=(1e-3,)
    )
    rng = np.random.default_rng(7)
    lines, phases = 2 * np.pi * rng.uniform(5.0, 180.0, 12), rng.uniform(0.0, 6.0, 12)
    t = np.arange(1, 301) / device.sample_rate
    u = np.sum(2e3 * np.sin(np.outer(t, lines) + phases), axis=1)

    def field(time: float, s: Array) -> list[float]:
        return [s[1], np.sum(2e3 * np.sin(lines * time + phases)) - 30.0 * s[1] - 1.8e5 * s[0]]

    # Begun after a hundred samples, so that the record's ends are another test's matter.
    reference = solve_ivp(field, (t[99], t[-101]), [0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    drive = drive_polynomials(u[:, None], hold)[100:-100]
    found = Observer(device, ObserverSettings()).run(np.full((100, 1), np.nan), drive).state[-1, :2]
    error = np.max(np.abs(found - reference) / [0.1, 0.1 * np.sqrt(1.8e5)])
    assert error < limit
    if hold != "bandlimited":
        assert error > 1e-3


def test_what_cannot_be_a_drive_is_refused() -> None:
    with pytest.raises(ModelError, match="no hold 'cubic'; known: zoh, foh, bandlimited"):
        drive_polynomials(np.zeros((3, 1)), "cubic")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="row 1 of the drive is not a number"):
        drive_polynomials(np.array([[0.0], [np.nan], [np.inf]]), "zoh")
