"""A spring that slips, hidden in an emulated device: a trace tells its stiffness and its reach."""

import numpy as np
import pytest

from estimator.diagnosis import Diagnosis, Verdict
from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, Spread
from estimator.trace.problem import Problem
from estimator.trace.trace import trace
from tests.emulator.gyro import AMPLITUDE_M, OMEGA, record, scenario, undriven

RATE, SAMPLES, MASS = 4000.0, 8000, 1e-3
K, D = OMEGA**2, 6.0
NOISE_M = 1e-7
FULL_SCALE = 10.0 / 2**15
HIDDEN = {"name": "hysteretic_stiffness", "khx": 0.02 * K, "khy": 0.02 * K, "reach": 3e-5}
NAME = HIDDEN["name"]


def emulated(start_m: float, push: np.ndarray, hidden: bool) -> Record:
    """What the x axis of the emulated device shows, with noise, and what drove it, m/s²."""
    truth = {
        "mass_kg": MASS,
        "stiffness_N_per_m": [K * MASS, K * MASS, 0.0],
        "damping_N_s_per_m": [D * MASS, D * MASS, 0.0],
        "position_m": [start_m, 0.0],
        "velocity_mps": [0.0, 0.0],
    }
    codes = undriven(SAMPLES)
    codes[:, 0] = np.round(push / FULL_SCALE)
    x = record(scenario({"truth": truth, "effect": [HIDDEN] if hidden else []}), codes).truth["x_m"]
    seen = x + NOISE_M * np.random.default_rng(4).standard_normal(SAMPLES)
    return Record(seen[:, None], FULL_SCALE * codes[:, :1, None], np.full(SAMPLES, 1.0 / RATE))


def decay(hidden: bool = True) -> Record:
    """Released from the nominal amplitude, until the spring slips no more."""
    return emulated(AMPLITUDE_M, np.zeros(SAMPLES), hidden)


def driven() -> Record:
    """Pushed by a dozen sines about the resonance, so that the amplitude beats."""
    rng, t = np.random.default_rng(1), np.arange(SAMPLES) / RATE
    sines = OMEGA * (1.0 + rng.uniform(-0.02, 0.02, 12)), rng.uniform(0.0, 2.0 * np.pi, 12)
    push = np.sum([np.sin(omega * t + phase) for omega, phase in zip(*sines, strict=True)], axis=0)
    return emulated(0.0, 0.02 * K * AMPLITUDE_M * push / np.std(push), True)


def traced(what: Record) -> Diagnosis:
    device = Device(
        sample_rate=RATE,
        stiffness=(1.004 * K,),
        damping=(1.3 * D,),
        amplitude=AMPLITUDE_M,
        sense_gain=(1.0,),
        noise=(NOISE_M,),
    )
    settings = ObserverSettings(gain=Gain.EKF, spread=Spread(stiffness=0.02, damping=2.0))
    return trace(Problem(what, device, settings), split=round(0.6 * SAMPLES))


@pytest.mark.parametrize("what", [decay, driven])
@pytest.mark.long
def test_it_is_named_with_its_coefficients(what) -> None:
    said = traced(what())
    assert said.verdict is Verdict.EXPLAINED
    (found,) = said.effects
    assert found.name == NAME
    for symbol in ("khx", "reach"):
        interval = found.coefficients[symbol]
        half = 0.5 * (interval.high - interval.low)
        assert half < 0.01 * HIDDEN[symbol]
        assert abs(interval.value - HIDDEN[symbol]) < 1.5 * half, symbol


@pytest.mark.slow
def test_a_spring_that_slips_nowhere_is_not_named() -> None:
    said = traced(decay(hidden=False))
    assert (said.verdict, said.effects) == (Verdict.ADEQUATE, ())
    assert NAME in [one.name for one in said.rejected]
