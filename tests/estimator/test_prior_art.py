"""Each method of the prior art where it must work: a device without what it cannot handle; it reaches its noise limit.

The ideal device is the closed form of (10), z̈ + 2iΩ ż + k z = 0, and the plant of `gyro_loop`; the limits are written
out here from the noise alone.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from estimator.bound import posterior_bound
from estimator.errors import ModelError
from estimator.prior_art import friedland_hutton, integrated_rate, raw_pattern
from estimator.prior_art.park_horowitz import Gains, ParkHorowitz
from estimator.prior_art.reading import virtual_angle
from estimator.settings import ControllerSettings, ObserverSettings, ProcessNoise, Sensed, Spread
from tests.estimator.gyro_loop import Truth, swing

K = (2.0 * math.pi * 200.0) ** 2
RATE = 1.3
TRUTH = Truth(stiffness=(1.0, 1.0, 0.0), damping=(0.0, 0.0, 0.0), offset=(0.0, 0.0))
DEVICE = TRUTH.device()


def foucault(n, rate=RATE, virtual=0.0, roundness=0.0):
    """x, y (n, 2) [m] of the ideal oscillator on a board that turns at a constant rate."""
    t = np.arange(n) / TRUTH.sample_rate
    w = math.sqrt(K + (rate + virtual) ** 2)
    one, other = 0.5 * (1.0 + roundness), 0.5 * (1.0 - roundness)
    z = np.exp(-1j * (rate + virtual) * t) * (one * np.exp(1j * w * t) + other * np.exp(-1j * w * t))
    return TRUTH.amplitude * np.column_stack([z.real, z.imag])


def volts(position, noise=0.0, offset=(0.0, 0.0), seed=0):
    clean = position * TRUTH.sense_gain + offset
    return clean + noise * np.random.default_rng(seed).standard_normal(clean.shape)


METHODS = {
    "raw": lambda v: raw_pattern.read(v, DEVICE),
    "averaged": lambda v: raw_pattern.read(v, DEVICE, cycles=1),
    "elements": lambda v: friedland_hutton.read(v, DEVICE),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rate", [RATE, -0.4])
def test_the_pattern_turns_with_the_board_and_not_against_it(method, rate):
    reading = METHODS[method](volts(foucault(8000, rate)))
    turned = rate * reading.index / TRUTH.sample_rate
    error = reading.angle - turned
    # (11) with velocities in the board's frame ripples by Ω/2ω, which is 0.5 mrad here.
    assert np.ptp(error) < 2.5 * abs(rate) / math.sqrt(K)
    assert np.polyfit(turned, reading.angle, 1)[0] == pytest.approx(1.0, abs=2e-4)


@pytest.mark.parametrize("method", METHODS)
def test_the_virtual_rotation_is_taken_off_with_its_reversals(method):
    control = ControllerSettings(1, 1.0, 1.0, 1.0, virtual_rotation=2.0)
    sense = volts(foucault(8000, RATE, virtual=2.0))
    read = {
        "raw": lambda: raw_pattern.read(sense, DEVICE, control),
        "averaged": lambda: raw_pattern.read(sense, DEVICE, control, cycles=1),
        "elements": lambda: friedland_hutton.read(sense, DEVICE, control),
    }[method]
    reading = read()
    assert np.polyfit(reading.index / TRUTH.sample_rate, reading.angle, 1)[0] == pytest.approx(RATE, abs=1e-3)


def test_reversals_come_every_period_and_first_after_half_of_one():
    control = ControllerSettings(1, 1.0, 1.0, 1.0, virtual_rotation=3.0, virtual_reversal=2.0)
    index = np.arange(40_000)
    found = virtual_angle(index, DEVICE, control)
    seconds = (index + 0.5) / DEVICE.sample_rate
    rates = np.where(np.round(seconds / 2.0) % 2 == 1, -3.0, 3.0)
    assert np.allclose(found, np.cumsum(rates) / DEVICE.sample_rate, atol=2e-3)


def test_noise_of_the_raw_formula_is_that_of_one_sample():
    # θ ≈ (k x δy + ẋ δẏ)/(k A²) on a straight line along x; δẏ from two samples.
    sense = volts(foucault(40_000, 0.0), noise=TRUTH.noise)
    ratio = TRUTH.noise / abs(TRUTH.sense_gain) / TRUTH.amplitude
    step = math.sqrt(K) / TRUTH.sample_rate
    limit = ratio * math.sqrt(0.5 * (1.0 + 1.0 / (2.0 * math.sin(step) ** 2)))
    assert np.std(raw_pattern.read(sense, DEVICE).angle) == pytest.approx(limit, rel=0.03)


@pytest.mark.moderate
def test_noise_of_the_elements_is_that_of_their_window():
    # In phase with x the phasor of y has the variance 2 σ² Σw²/(Σw)² = 3 σ²/N of a Hann window of N samples; carried on
    # by 2 θ − θ(half a window before), of which a sixth is common, it is 5 − 4/6 times that.
    sense = volts(foucault(120_000, 0.0), noise=TRUTH.noise)
    ratio = TRUTH.noise / abs(TRUTH.sense_gain) / TRUTH.amplitude
    limit = ratio * math.sqrt(3.0 / 81.0 * (5.0 - 4.0 / 6.0))
    assert np.std(friedland_hutton.read(sense, DEVICE).angle) == pytest.approx(limit, rel=0.1)


def test_an_offset_ripples_in_the_raw_formula_and_not_in_the_elements():
    offset = (0.1 * TRUTH.sense_gain * TRUTH.amplitude, -0.08 * TRUTH.sense_gain * TRUTH.amplitude)
    sense = volts(foucault(8000), offset=offset)

    def error(reading):
        return np.std(reading.angle - RATE * reading.index / TRUTH.sample_rate)

    raw, averaged, elements = (error(METHODS[name](sense)) for name in ("raw", "averaged", "elements"))
    assert raw > 0.03
    assert averaged < 0.01
    assert elements < 1e-3


def test_elements_do_not_care_for_quadrature_and_skip_what_was_lost():
    sense = volts(foucault(8000, roundness=0.2))
    sense[4000] = np.nan
    reading = friedland_hutton.read(sense, DEVICE)
    assert np.ptp(reading.angle - RATE * reading.index / TRUTH.sample_rate) < 2e-3
    assert not {4000, 4040} & set(reading.index.tolist())


def along(n):
    """True state vectors (n, 13) of the ideal device."""
    w = math.sqrt(K + RATE**2)
    t = np.arange(n) / TRUTH.sample_rate
    turned = np.exp(-1j * RATE * t) * TRUTH.amplitude
    z, dz = turned * np.cos(w * t), turned * (-1j * RATE * np.cos(w * t) - w * np.sin(w * t))
    states = np.zeros((n, 13))
    states[:, :4] = np.column_stack([z.real, dz.real, z.imag, dz.imag])
    states[:, 6], states[:, 7:] = RATE, TRUTH.parameters
    return states


# -- (a) ---------------------------------------------------------------------------------------------------------------

MISTUNED = Truth()  # ± 2 % stiffness, ± 10 % damping, offsets of 10 %


def driven(truth, n, rate, seed=0, noise=True):
    """Sense (n, 2) and drive (n, 2) of a device under a random drive held from sample to sample."""
    rng = np.random.default_rng(seed)
    p, h = truth.parameters, 1.0 / truth.sample_rate
    s = np.array(truth.start) * truth.amplitude * np.array([1.0, truth.omega0, 1.0, truth.omega0])
    drive = np.zeros((n, 2))
    position = np.zeros((n, 2))
    for m in range(n):
        # What keeps it going, and shakes it.
        force = truth.omega0 * 1e-3 * s[[1, 3]] + rng.standard_normal(2)
        swing(s, p, force[0], force[1], rate, rate, h)
        drive[m], position[m] = force, s[[0, 2]]
    sense = position * truth.sense_gain + truth.offset
    return sense + noise * truth.noise * rng.standard_normal((n, 2)), drive


@pytest.mark.moderate
def test_the_identified_rate_and_constants_are_the_plants():
    sense, drive = driven(MISTUNED, 8000, RATE, noise=False)
    reading = integrated_rate.read(sense, drive, MISTUNED.device(stiffness=1.02, damping=0.7), ObserverSettings())
    found = np.array([reading.parameters[name][-1] for name in ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy")])
    true = MISTUNED.parameters
    assert np.abs(found[:3] / MISTUNED.omega0**2 - true[:3] / MISTUNED.omega0**2).max() < 3e-6
    assert np.abs(found[3:] - true[3:]).max() < 3e-3 * true[3]
    assert reading.rate is not None
    assert reading.rate[-1] == pytest.approx(RATE, abs=2e-3)
    assert np.polyfit(reading.index[40:], reading.angle[40:], 1)[0] * MISTUNED.sample_rate == pytest.approx(
        RATE, abs=2e-3
    )


@pytest.mark.moderate
def test_the_identified_rate_comes_near_the_bound_where_all_else_is_known():
    # Windows that overlap by three quarters are weighted as if they did not, which costs a factor of about two.
    known = Spread(offset=1e-9, rate=1.0, stiffness=1e-9, damping=1e-9)
    settings = ObserverSettings(spread=known, process_noise=ProcessNoise())
    device, n = TRUTH.device(), 2000
    errors = []
    for seed in range(12):
        sense, drive = driven(TRUTH, n, RATE, seed=seed)
        reading = integrated_rate.read(sense, drive, device, settings)
        assert reading.rate is not None
        errors.append(reading.rate[-1] - RATE)
    least = posterior_bound(device, settings, along(n), np.zeros((n, 2)), every=n).of("rate")[-1]
    rms = math.sqrt(float(np.mean(np.square(errors))))
    assert 0.6 * least < rms < 3.0 * least


# -- (d) ---------------------------------------------------------------------------------------------------------------


def adaptive(truth, n, rate, noise=True, gains=None, seed=0, device=None):
    """The controller around the plant, one sample of latency."""
    rng = np.random.default_rng(seed)
    controller = ParkHorowitz(device or truth.device(stiffness=1.02, damping=0.5), truth.controller(), gains)
    p, h = truth.parameters, 1.0 / truth.sample_rate
    s = np.array(truth.start) * truth.amplitude * np.array([1.0, truth.omega0, 1.0, truth.omega0])
    acting = queued = (0, 0)
    rates = np.full(n, rate) if np.ndim(rate) == 0 else rate
    for m in range(n):
        measured = truth.sense_gain * s[[0, 2]] + truth.offset + noise * truth.noise * rng.standard_normal(2)
        codes = np.rint(measured / truth.sense_quantum)
        command = controller.tick(codes[0], codes[1], *acting)
        acting, queued = queued, command
        force = np.array(acting) * truth.force_quantum
        swing(s, p, force[0], force[1], rates[m], rates[m], h)
    return controller.reading


@pytest.mark.slow
@pytest.mark.parametrize("rate", [RATE, -RATE])
def test_adaptive_control_finds_rate_and_constants(rate):
    reading = adaptive(MISTUNED, 12_000, rate, noise=False)
    assert reading.rate is not None
    late = slice(6000, None)
    # A sine of the difference of the two frequencies stays in the estimate: as large as the adaptation is fast.
    assert np.mean(reading.rate[late]) == pytest.approx(rate, abs=0.01)
    assert np.polyfit(np.arange(6000), reading.angle[late], 1)[0] * MISTUNED.sample_rate == pytest.approx(
        rate, abs=0.01
    )
    found = np.array([np.mean(reading.parameters[name][late]) for name in ("kxx", "kyy", "kxy")])
    assert np.abs(found - MISTUNED.parameters[:3]).max() < 3e-4 * MISTUNED.omega0**2
    found = np.array([np.mean(reading.parameters[name][late]) for name in ("dxx", "dyy")])
    assert np.abs(found - MISTUNED.parameters[3:5]).max() < 0.1 * MISTUNED.parameters[3]


@pytest.mark.slow
def test_noise_of_the_adaptive_rate_goes_with_the_noise():
    quiet = replace(TRUTH, sense_quantum=TRUTH.sense_quantum / 64)

    def spread(times):
        truth = replace(quiet, noise=times * quiet.noise)
        return np.std(adaptive(truth, 8000, 0.0, gains=slow, device=truth.device()).rate[4000:])

    slow = Gains(feedback=0.1, parameters=1e-6, rate=0.004, observer=0.2)
    assert spread(6.0) / spread(2.0) == pytest.approx(3.0, rel=0.15)


# -- what cannot be read -----------------------------------------------------------------------------------------------


def test_what_is_too_short_or_has_one_axis_is_refused():
    single = replace(DEVICE, stiffness=(K,), damping=(1.0,), sense_gain=(-890.0,), noise=(1e-4,))
    with pytest.raises(ModelError, match="two axes"):
        raw_pattern.read(np.zeros((100, 1)), single)
    with pytest.raises(ModelError, match="two axes"):
        ParkHorowitz(single, TRUTH.controller())
    for read in (
        lambda: friedland_hutton.read(np.zeros((50, 2)), DEVICE),
        lambda: friedland_hutton.read(np.zeros((100, 2)), DEVICE),
        lambda: raw_pattern.read(np.zeros((10, 2)), DEVICE, cycles=1),
        lambda: integrated_rate.read(np.zeros((90, 2)), np.zeros((90, 2)), DEVICE, ObserverSettings()),
    ):
        with pytest.raises(ModelError, match="longer record"):
            read()


def test_what_reads_a_displacement_refuses_a_velocity() -> None:
    moving = replace(DEVICE, sensed=(Sensed.VELOCITY, Sensed.VELOCITY))
    sense = volts(foucault(4000))
    with pytest.raises(ModelError, match="show its velocity"):
        integrated_rate.read(sense, np.zeros_like(sense), moving, ObserverSettings())
    with pytest.raises(ModelError, match="show its velocity"):
        ParkHorowitz(moving, ControllerSettings(latency=1, force_quantum=1e-3, force_limit=10.0, sense_quantum=1e-5))
    assert len(raw_pattern.read(sense, moving).angle) == len(sense) - 2  # the same ellipse, a quarter of a cycle on
