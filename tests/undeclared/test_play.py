"""An element with play, hidden in an emulated device: a trace tells its stiffness and its play."""

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
NAME = "play"


def emulated(start_m: float, push: np.ndarray, kp: float, half_width: float, seed: int = 4) -> Record:
    """What the x axis of the emulated device shows, with noise, and what drove it, m/s²; kp as a share of the spring's
    stiffness, 0 for none.
    """
    truth = {
        "mass_kg": MASS,
        "stiffness_N_per_m": [K * MASS, K * MASS, 0.0],
        "damping_N_s_per_m": [D * MASS, D * MASS, 0.0],
        "position_m": [start_m, 0.0],
        "velocity_mps": [0.0, 0.0],
    }
    hidden = [{"name": NAME, "kpx": kp * K, "kpy": kp * K, "half_width": half_width}] if kp else []
    codes = undriven(SAMPLES)
    codes[:, 0] = np.round(push / FULL_SCALE)
    x = record(scenario({"truth": truth, "effect": hidden}), codes).truth["x_m"]
    seen = x + NOISE_M * np.random.default_rng(seed).standard_normal(SAMPLES)
    return Record(seen[:, None], FULL_SCALE * codes[:, :1, None], np.full(SAMPLES, 1.0 / RATE))


def decay(kp: float, half_width: float, seed: int = 4, share: float = 1.0) -> Record:
    """Released from a share of the nominal amplitude, until the foot stays where it is."""
    return emulated(share * AMPLITUDE_M, np.zeros(SAMPLES), kp, half_width, seed)


def driven(kp: float, half_width: float, seed: int = 1) -> Record:
    """Pushed by a dozen sines about the resonance, so that the amplitude beats."""
    rng, t = np.random.default_rng(seed), np.arange(SAMPLES) / RATE
    sines = OMEGA * (1.0 + rng.uniform(-0.02, 0.02, 12)), rng.uniform(0.0, 2.0 * np.pi, 12)
    push = np.sum([np.sin(omega * t + phase) for omega, phase in zip(*sines, strict=True)], axis=0)
    return emulated(0.0, 0.02 * K * AMPLITUDE_M * push / np.std(push), kp, half_width, seed)


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


@pytest.mark.long
@pytest.mark.parametrize("what", [decay, driven])
def test_it_is_named_with_its_coefficients(what) -> None:
    hidden = {"kpx": 0.02 * K, "half_width": 3e-5}
    said = traced(what(0.02, 3e-5))
    assert said.verdict is Verdict.EXPLAINED
    (found,) = said.effects
    assert found.name == NAME
    for symbol, true in hidden.items():
        interval = found.coefficients[symbol]
        half = 0.5 * (interval.high - interval.low)
        assert half < 0.01 * true
        assert abs(interval.value - true) < 1.5 * half, symbol


@pytest.mark.slow
@pytest.mark.parametrize(("kp", "half_width"), [(0.0, 3e-5), (0.02, 1.2e-4)], ids=["none", "below its half-width"])
def test_where_no_foot_moves_nothing_is_named(kp: float, half_width: float) -> None:
    said = traced(decay(kp, half_width))
    assert (said.verdict, said.effects) == (Verdict.ADEQUATE, ())
    assert NAME in [one.name for one in said.rejected]
