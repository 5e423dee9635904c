"""Each method of the prior art where it must work: a device without what it cannot handle; it reaches its noise limit.

The ideal device is the closed form of (10), z̈ + 2iΩ ż + k z = 0, and the plant of `gyro_loop`; the limits are written
out here from the noise alone.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import hil
from estimator.bound import posterior_bound
from estimator.settings import ObserverSettings, ProcessNoise, Spread
from hil.bench.examples import directory
from hil.plugins.finding import found
from hil.testing.conformance import PluginConformance
from tests.estimator.gyro_loop import Truth, ideal_states, swing

K = (2.0 * math.pi * 200.0) ** 2
RATE = 1.3
TRUTH = Truth(stiffness=(1.0, 1.0, 0.0), damping=(0.0, 0.0, 0.0), offset=(0.0, 0.0))
MISTUNED = Truth()  # ± 2 % stiffness, ± 10 % damping, offsets of 10 %
CYCLE = 20
FIRST = 10 * CYCLE
"""From here on every window is full, and a slope is known."""


def brought(name):
    """A class of examples/prior-art."""
    return found("observer", str(directory() / "prior-art" / name))


def settings_of(method):
    """The constants of its file."""
    return method.observe.__globals__


METHODS = {name: brought(f"pattern.py:{name}") for name in ("RawFormula", "AveragedFormula", "OrbitalElements")}


def declared(truth=TRUTH, **changes):
    """The device as a plug-in is told of it."""
    device = hil.DeclaredDevice.of(truth.device(**changes), truth.controller())
    return replace(device, virtual_rotation_rad_s=0.0)


def read(method, sense, drive=None, imposed=None, device=None):
    """Angle, rate (n,) and the constants at the end, from sense (n, 2) in volts."""
    observer = method(device or declared())
    n = len(sense)
    drive = np.zeros((n, 2)) if drive is None else drive
    imposed = np.zeros(n) if imposed is None else imposed
    told = [observer.observe(tuple(v), tuple(u), w) for v, u, w in zip(sense, drive, imposed, strict=True)]
    return np.array([one.angle for one in told]), np.array([one.rate for one in told]), told[-1]


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


def error(angle, rate=RATE):
    """Of the angle once it is known, but for a constant."""
    return (angle - rate * np.arange(len(angle)) / TRUTH.sample_rate)[FIRST:]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rate", [RATE, -0.4])
def test_the_angle_turns_with_the_board_and_not_against_it(method, rate):
    angle, found_rate, _ = read(METHODS[method], volts(foucault(8000, rate)))
    # (11) with velocities in the board's frame ripples by Ω/2ω, which is 0.5 mrad here.
    assert np.ptp(error(angle, rate)) < 2.5 * abs(rate) / math.sqrt(K)
    assert np.polyfit(np.arange(8000)[FIRST:], angle[FIRST:], 1)[0] * TRUTH.sample_rate == pytest.approx(rate, abs=3e-4)
    assert np.mean(found_rate[FIRST:]) == pytest.approx(rate, rel=5e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("period", [1.0, 0.25])
def test_the_virtual_rotation_is_taken_off_with_its_reversals(method, period):
    n = 8000
    seconds = (np.arange(n) + 0.5) / TRUTH.sample_rate
    imposed = np.where(np.round(seconds / period) % 2 == 1, -2.0, 2.0)
    turned = np.cumsum(np.r_[0.0, imposed[1:]]) / TRUTH.sample_rate
    z = foucault(n) @ [1.0, 1.0j] * np.exp(-1j * turned)
    angle, _, _ = read(METHODS[method], volts(np.column_stack([z.real, z.imag])), imposed=imposed)
    # A reversal changes the slope by which the angle is carried on, over the samples that it is taken from.
    assert np.ptp(error(angle)) < 4.0 * 2.0 * 40 / TRUTH.sample_rate
    assert np.polyfit(np.arange(n)[FIRST:], angle[FIRST:], 1)[0] * TRUTH.sample_rate == pytest.approx(RATE, abs=2e-3)


def test_noise_of_the_raw_formula_is_that_of_one_sample():
    # θ ≈ (k x δy + ẋ δẏ)/(k A²) on a straight line along x; δẏ from two samples.
    ratio = TRUTH.noise / abs(TRUTH.sense_gain) / TRUTH.amplitude
    step = math.sqrt(K) / TRUTH.sample_rate
    limit = ratio * math.sqrt(0.5 * (1.0 + 1.0 / (2.0 * math.sin(step) ** 2)))
    angle, _, _ = read(METHODS["RawFormula"], volts(foucault(40_000, 0.0), noise=TRUTH.noise))
    assert np.std(angle[FIRST:]) == pytest.approx(limit, rel=0.03)


@pytest.mark.moderate
def test_noise_of_the_elements_is_that_of_their_window():
    # In phase with x the phasor of y has the variance 2 σ² Σw²/(Σw)² = 3 σ²/N of a Hann window of N samples; carried on
    # by 2 θ − θ(half a window before), of which a sixth is common, it is 5 − 4/6 times that.
    ratio = TRUTH.noise / abs(TRUTH.sense_gain) / TRUTH.amplitude
    limit = ratio * math.sqrt(3.0 / 81.0 * (5.0 - 4.0 / 6.0))
    angle, _, _ = read(METHODS["OrbitalElements"], volts(foucault(120_000, 0.0), noise=TRUTH.noise))
    assert np.std(angle[FIRST:]) == pytest.approx(limit, rel=0.1)


def test_an_offset_ripples_in_the_raw_formula_and_not_in_the_elements():
    offset = (0.1 * TRUTH.sense_gain * TRUTH.amplitude, -0.08 * TRUTH.sense_gain * TRUTH.amplitude)
    sense = volts(foucault(8000), offset=offset)
    raw, averaged, elements = (np.std(error(read(method, sense)[0])) for method in METHODS.values())
    assert raw > 0.03
    assert averaged < 0.01
    assert elements < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_the_board_is_taken_to_turn_on_where_samples_are_lost(method):
    sense = volts(foucault(8000, roundness=0.2))
    sense[4000:4003] = np.nan
    assert np.ptp(error(read(method=METHODS[method], sense=sense)[0])) < 4e-3


def test_the_elements_do_not_care_for_quadrature():
    angle, _, _ = read(METHODS["OrbitalElements"], volts(foucault(8000, roundness=0.2)))
    assert np.ptp(error(angle)) < 2e-3


@pytest.mark.parametrize("method", METHODS)
def test_a_velocity_shows_the_same_ellipse_a_quarter_cycle_on(method):
    moving = replace(declared(), sense_order=1, sense_gain_V_per_m=(TRUTH.sense_gain / math.sqrt(K),) * 2)
    angle, _, _ = read(METHODS[method], volts(foucault(4000)), device=moving)
    assert np.ptp(error(angle)) < 2.5 * RATE / math.sqrt(K)


@pytest.mark.parametrize("name", ["modulated.py:ModulatedRate", "park_horowitz.py:ParkHorowitz"])
def test_what_reads_a_displacement_refuses_a_velocity(name):
    with pytest.raises(ValueError, match="not the velocity"):
        brought(name)(replace(declared(), sense_order=1))


# -- (a) ---------------------------------------------------------------------------------------------------------------

MODULATED = brought("modulated.py:ModulatedRate")


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
def test_the_identified_rate_and_constants_are_the_plants(monkeypatch):
    monkeypatch.setitem(settings_of(MODULATED), "WALK", 0.0)
    sense, drive = driven(MISTUNED, 8000, RATE, noise=False)
    angle, rate, told = read(MODULATED, sense, drive, device=declared(MISTUNED, stiffness=1.02, damping=0.7))
    constants = np.array([told.constants[name] for name in ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy")])
    true = MISTUNED.parameters
    assert np.abs(constants[:3] - true[:3]).max() < 3e-6 * MISTUNED.omega0**2
    assert np.abs(constants[3:] - true[3:]).max() < 3e-3 * true[3]
    assert rate[-1] == pytest.approx(RATE, abs=2e-3)
    assert np.polyfit(np.arange(2000, 8000), angle[2000:], 1)[0] * MISTUNED.sample_rate == pytest.approx(RATE, abs=2e-3)


@pytest.mark.moderate
def test_the_identified_rate_comes_near_its_bound(monkeypatch):
    """Where all else is known.  Windows that overlap by three quarters are weighted as if they did not, which costs a
    factor of about two."""
    monkeypatch.setitem(settings_of(MODULATED), "SPREAD", {"stiffness": 1e-9, "damping": 1e-9, "rate_rad_s": 1.0})
    monkeypatch.setitem(settings_of(MODULATED), "WALK", 0.0)
    known = Spread(offset=1e-9, rate=1.0, stiffness=1e-9, damping=1e-9)
    settings = ObserverSettings(spread=known, process_noise=ProcessNoise())
    n, errors = 2000, []
    for seed in range(12):
        sense, drive = driven(TRUTH, n, RATE, seed=seed)
        errors.append(read(MODULATED, sense, drive, device=declared(damping=1.0))[1][-1] - RATE)
    states = ideal_states(TRUTH, RATE, n)
    least = posterior_bound(TRUTH.device(), settings, states, np.zeros((n, 2)), every=n).of("rate")[-1]
    rms = math.sqrt(float(np.mean(np.square(errors))))
    assert 0.6 * least < rms < 3.0 * least


# -- (d) ---------------------------------------------------------------------------------------------------------------

PARK_HOROWITZ = brought("park_horowitz.py:ParkHorowitz")


@pytest.mark.moderate
class TestParkHorowitz(PluginConformance):
    observer = controller = str(directory() / "prior-art" / "park_horowitz.py:ParkHorowitz")
    energy = 1.1  # both axes vibrate by the amplitude: twice the energy


def adaptive(truth, n, rate, noise=True, seed=0, device=None):
    """The controller around the plant, one sample of latency."""
    rng = np.random.default_rng(seed)
    controller = PARK_HOROWITZ(device or declared(truth, stiffness=1.02, damping=0.5))
    p, h = truth.parameters, 1.0 / truth.sample_rate
    s = np.array(truth.start) * truth.amplitude * np.array([1.0, truth.omega0, 1.0, truth.omega0])
    acting = queued = np.zeros(2)
    told = []
    for _ in range(n):
        measured = truth.sense_gain * s[[0, 2]] + truth.offset + noise * truth.noise * rng.standard_normal(2)
        estimate = controller.observe(tuple(np.rint(measured / truth.sense_quantum) * truth.sense_quantum), (0, 0), 0.0)
        told.append(estimate)
        command = np.array(controller.control(estimate, True)[:2])
        acting, queued = queued, np.rint(command / truth.force_quantum) * truth.force_quantum
        swing(s, p, acting[0], acting[1], rate, rate, h)
    return np.array([one.angle for one in told]), np.array([one.rate for one in told]), [one.constants for one in told]


@pytest.mark.slow
@pytest.mark.parametrize("rate", [RATE, -RATE])
def test_adaptive_control_finds_rate_and_constants(rate):
    angle, rates, constants = adaptive(MISTUNED, 12_000, rate, noise=False)
    # A sine of the difference of the two frequencies stays in the estimate: as large as the adaptation is fast.
    assert np.mean(rates[6000:]) == pytest.approx(rate, abs=0.01)
    assert np.polyfit(np.arange(6000), angle[6000:], 1)[0] * MISTUNED.sample_rate == pytest.approx(rate, abs=0.01)

    def mean(*names):
        return np.array([np.mean([one[name] for one in constants[6000:]]) for name in names])

    assert np.abs(mean("kxx", "kyy", "kxy") - MISTUNED.parameters[:3]).max() < 3e-4 * MISTUNED.omega0**2
    assert np.abs(mean("dxx", "dyy") - MISTUNED.parameters[3:5]).max() < 0.1 * MISTUNED.parameters[3]


@pytest.mark.slow
def test_noise_of_the_adaptive_rate_goes_with_the_noise(monkeypatch):
    for name, value in {"FEEDBACK": 0.1, "PARAMETERS": 1e-6, "RATE": 0.004, "OBSERVER": 0.2}.items():
        monkeypatch.setitem(settings_of(PARK_HOROWITZ), name, value)
    quiet = replace(TRUTH, sense_quantum=TRUTH.sense_quantum / 64)

    def spread(times):
        truth = replace(quiet, noise=times * quiet.noise)
        return np.std(adaptive(truth, 8000, 0.0, device=declared(truth))[1][4000:])

    assert spread(6.0) / spread(2.0) == pytest.approx(3.0, rel=0.15)
