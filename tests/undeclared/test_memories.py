"""Springs with a memory, hidden in an emulated device: a trace tells what each is, its stiffness and its reach."""

from collections.abc import Callable

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
MEMORIES = {"play": ("kp", "half_width"), "hysteretic_stiffness": ("kh", "reach")}
"""Of each, what its stiffness and its length are called."""


def emulated(start_m: float, push: np.ndarray, name: str, share: float, length: float) -> Record:
    """What the x axis of the emulated device shows, with noise, and what drove it, m/s²; share: of the spring's
    stiffness, 0 for none.
    """
    truth = {
        "mass_kg": MASS,
        "stiffness_N_per_m": [K * MASS, K * MASS, 0.0],
        "damping_N_s_per_m": [D * MASS, D * MASS, 0.0],
        "position_m": [start_m, 0.0],
        "velocity_mps": [0.0, 0.0],
    }
    stiffness, reach = MEMORIES[name]
    hidden = {"name": name, f"{stiffness}x": share * K, f"{stiffness}y": share * K, reach: length}
    codes = undriven(SAMPLES)
    codes[:, 0] = np.round(push / FULL_SCALE)
    x = record(scenario({"truth": truth, "effect": [hidden] if share else []}), codes).truth["x_m"]
    seen = x + NOISE_M * np.random.default_rng(4).standard_normal(SAMPLES)
    return Record(seen[:, None], FULL_SCALE * codes[:, :1, None], np.full(SAMPLES, 1.0 / RATE))


def decay(name: str, share: float, length: float) -> Record:
    """Released from the nominal amplitude, until nothing slips any more."""
    return emulated(AMPLITUDE_M, np.zeros(SAMPLES), name, share, length)


def driven(name: str, share: float, length: float) -> Record:
    """Pushed by a dozen sines about the resonance, so that the amplitude beats."""
    rng, t = np.random.default_rng(1), np.arange(SAMPLES) / RATE
    sines = OMEGA * (1.0 + rng.uniform(-0.02, 0.02, 12)), rng.uniform(0.0, 2.0 * np.pi, 12)
    push = np.sum([np.sin(omega * t + phase) for omega, phase in zip(*sines, strict=True)], axis=0)
    return emulated(0.0, 0.02 * K * AMPLITUDE_M * push / np.std(push), name, share, length)


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
@pytest.mark.parametrize("name", MEMORIES)
@pytest.mark.parametrize("what", [decay, driven])
def test_it_is_named_with_its_coefficients(what: Callable[[str, float, float], Record], name: str) -> None:
    stiffness, reach = MEMORIES[name]
    said = traced(what(name, 0.02, 3e-5))
    assert said.verdict is Verdict.EXPLAINED
    (found,) = said.effects
    assert found.name == name
    for symbol, true in ((f"{stiffness}x", 0.02 * K), (reach, 3e-5)):
        interval = found.coefficients[symbol]
        half = 0.5 * (interval.high - interval.low)
        assert half < 0.01 * true
        assert abs(interval.value - true) < 1.5 * half, symbol


@pytest.mark.slow
@pytest.mark.parametrize(("kp", "half_width"), [(0.0, 3e-5), (0.02, 1.2e-4)], ids=["none", "below its half-width"])
def test_where_nothing_slips_nothing_is_named(kp: float, half_width: float) -> None:
    said = traced(decay("play", kp, half_width))
    assert (said.verdict, said.effects) == (Verdict.ADEQUATE, ())
    assert set(MEMORIES) <= {one.name for one in said.rejected}
