"""Laws of damping named from an amplitude alone, beside SciPy's integration of the full equation of motion."""

import math

import numpy as np
import pytest

from estimator.diagnosis import Verdict
from estimator.envelope.record import Envelope, Resonator
from estimator.envelope.trace import by_turns, trace_envelope
from estimator.errors import ModelError
from estimator.settings import Device
from tests.envelope.ringing import AMPLITUDE_M, DAMPING, GAIN, LAWS, OMEGA0, decibels, envelope_of

NOISE_DB = 0.05
CLASS = {"nonlinear_damping": "nonlinear_damping", "cubic_damping": "nonlinear_damping"}


def resonator(noise=NOISE_DB, unit="dB", frequency_sd=1e-4):
    device = Device(
        sample_rate=40.0, stiffness=(OMEGA0**2,), damping=(1.2 * DAMPING,), amplitude=AMPLITUDE_M, sense_gain=(GAIN,),
        noise=(noise,), sense_unit=unit,
    )  # fmt: skip
    return Resonator(device, (1.2 * DAMPING, DAMPING), frequency_sd, noise)


def traced(time, shown, *, logarithmic=True, **given):
    return trace_envelope(Envelope(time, shown, logarithmic), resonator(**given), by_turns(len(time)))


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_named_with_its_coefficient(name):
    symbol, size, force = LAWS[name]
    time, amplitude = envelope_of([(size, force)], 8.0)
    found = traced(time, decibels(amplitude, NOISE_DB))
    assert found.verdict is Verdict.EXPLAINED
    (effect,) = found.effects
    assert effect.name == CLASS.get(name, name)
    assert found.held_out_after.ratio < 1.1 < 3.0 < found.held_out_before.ratio
    if name == "cubic_damping":  # told as its look-alike, with what it is otherwise
        (said,) = found.undetermined
        assert f"cubic_damping with dcx = {size:.2g}"[:26] in said
        assert {pair.other for pair in found.separations} >= {"cubic_damping"}
        symbol, size = "d3x", size * 3.0 * OMEGA0**2
    interval = effect.coefficients[symbol]
    assert interval.low < size < interval.high
    assert interval.high - interval.low < 0.1 * size


@pytest.mark.slow
def test_linear_damping_lacks_nothing():
    time, amplitude = envelope_of([], 8.0)
    found = traced(time, decibels(amplitude, NOISE_DB))
    assert found.verdict is Verdict.ADEQUATE
    assert found.effects == ()
    assert "a quality factor of 31" in found.reasons[0]


@pytest.mark.long
def test_friction_beside_drag_are_both_named():
    laws = [LAWS["dry_friction"][1:], LAWS["drag"][1:]]
    time, amplitude = envelope_of(laws, 8.0)
    found = traced(time, decibels(amplitude, NOISE_DB))
    assert found.verdict is Verdict.EXPLAINED
    assert {effect.name for effect in found.effects} == {"dry_friction", "drag"}
    for effect in found.effects:
        symbol, size, _ = LAWS[effect.name]
        assert effect.coefficients[symbol].low < size < effect.coefficients[symbol].high


@pytest.mark.slow
def test_an_amplitude_in_a_unit_of_its_own_has_the_same_law():
    symbol, size, force = LAWS["drag"]
    time, amplitude = envelope_of([(size, force)], 8.0)
    noise = 2e-3
    shown = GAIN * amplitude + np.random.default_rng(5).normal(0.0, noise, len(time))
    found = traced(time, np.abs(shown), logarithmic=False, noise=noise, unit="mm")
    (effect,) = found.effects
    assert effect.name == "drag"
    assert effect.coefficients[symbol].low < size < effect.coefficients[symbol].high


@pytest.mark.long
def test_noise_that_is_taken_for_amplitude_is_no_law():
    """√(a² + n²): the end of the ring-down is flat, as if it were fed."""
    time, amplitude = envelope_of([], 16.0)
    floor = 2e-2 * AMPLITUDE_M
    found = traced(time, decibels(np.hypot(amplitude, floor), NOISE_DB))
    (effect,) = found.effects
    assert effect.name == "noise_floor"
    interval = effect.coefficients["n"]
    assert interval.low < floor < interval.high


@pytest.mark.long
def test_what_the_resonance_is_known_to_widens_what_hangs_on_it():
    _, size, force = LAWS["drag"]
    time, amplitude = envelope_of([(size, force)], 8.0)
    shown = decibels(amplitude, NOISE_DB)
    sharp, vague = (traced(time, shown, frequency_sd=sd).effects[0].coefficients["dqx"] for sd in (1e-6, 0.025))
    assert vague.high - vague.low == pytest.approx(
        math.hypot(sharp.high - sharp.low, 2 * 1.96 * 0.025 * sharp.value), rel=1e-3
    )


@pytest.mark.slow
def test_another_law_than_those_of_the_catalogue_is_not_given_a_name():
    """A damping that switches at half of the amplitude."""
    size = 3.0 * DAMPING
    time, amplitude = envelope_of([(size, lambda x, v: v * (x**2 + (v / OMEGA0) ** 2 > (0.5 * AMPLITUDE_M) ** 2))], 8.0)
    found = traced(time, decibels(amplitude, NOISE_DB))
    assert found.verdict in (Verdict.PARTLY, Verdict.UNEXPLAINED)


@pytest.mark.moderate
def test_what_is_no_ring_down_is_refused():
    time = np.arange(100) / 40.0
    with pytest.raises(ModelError, match="does not fall"):
        traced(time, 0.1 * time)
    with pytest.raises(ModelError, match="too few"):
        traced(time[:20], -time[:20])
    with pytest.raises(ModelError, match="row 7"):
        traced(time, np.where(np.arange(100) == 7, np.nan, -time))
    with pytest.raises(ModelError, match="row 3 is 0"):
        traced(time, np.where(np.arange(100) == 3, 0.0, 1.0), logarithmic=False)
    with pytest.raises(ModelError, match="increase"):
        traced(time[::-1], -time)


@pytest.mark.long
def test_intervals_hold_the_truth_as_often_as_they_say():
    """Forty draws of the noise; by the residual's spectrum alone the scatter was 1.3 times what the intervals said."""
    symbol, size, force = LAWS["drag"]
    time, amplitude = envelope_of([(size, force)], 8.0)
    off = []
    for seed in range(40):
        (effect,) = traced(time, decibels(amplitude, NOISE_DB, seed), frequency_sd=0.0).effects
        interval = effect.coefficients[symbol]
        off.append((interval.value - size) / (0.5 * (interval.high - interval.low)))
    assert sum(abs(one) <= 1.0 for one in off) >= 35
    assert 0.75 < 1.96 * np.std(off) < 1.2
