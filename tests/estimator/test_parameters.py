"""A frequency that no filter estimates is found where it is, with an interval that says how surely."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.identification.experiments import EXPERIMENTS, loop_record
from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread
from estimator.trace.fitting import fit
from estimator.trace.observer_model import Carrying, ObserverModel
from estimator.trace.parameters import refine_parameters
from estimator.trace.problem import Problem
from estimator.trace.searched import NOTHING

K = (2 * np.pi * 200.0) ** 2
NOISE, OMEGA = 9e-5, 777.0
DEVICE = Device(
    sample_rate=4000.0,
    stiffness=(K, K, 0.0),
    damping=(1.3, 1.1, 0.0),
    amplitude=1e-4,
    sense_gain=(-890.0, -890.0),
    noise=(NOISE, NOISE),
    target_stiffness=K,
)
SETTINGS = ObserverSettings(
    gain=Gain.EKF,
    spread=Spread(offset=1e-3, rate=0.1, stiffness=1e-4, damping=0.01),
    process_noise=ProcessNoise(rate=0.5),
    initial={"x": 1e-4, "vx": 0.0},
)


def with_a_line(amplitude: float) -> Record:
    dithered = next(experiment for experiment in EXPERIMENTS if experiment.name == "dither")
    record = loop_record(dithered, DEVICE, SETTINGS, latency=1)
    line = amplitude * np.sin(OMEGA * record.time)[:, None]
    return Record(record.sense + line, record.drive, record.step, record.channels)


@pytest.mark.slow
@pytest.mark.parametrize("earlier", [None, NOTHING])
def test_a_frequency_is_found_within_its_bound(earlier: object) -> None:
    """Its deviation is that of a line in white noise, √(24/n) 2σ/(a T) for one channel (Rife & Boorstyn 1974)."""
    amplitude = 20 * NOISE
    record = with_a_line(amplitude)
    problem = Problem(record, DEVICE, SETTINGS)
    span = len(record) / DEVICE.sample_rate
    started = fit(problem.carrying({"interference": {"omega": OMEGA + 0.3 / span}}))
    found, searched = refine_parameters(problem, started, "interference", before=earlier)  # type: ignore[arg-type]
    omega = found.settings.effects["interference"]["omega"]
    bound = np.sqrt(24.0 / len(record) / 2) * NOISE / amplitude / span  # two channels, phase and amplitude unknown
    assert searched.names == ("omega",)
    assert searched.deviation("omega") == pytest.approx(bound, rel=0.35)
    assert abs(omega - OMEGA) < 3.0 * searched.deviation("omega")
    assert found.likelihood > started.likelihood


@pytest.mark.slow
def test_a_climb_that_cannot_win_ends_and_every_candidate_is_told(monkeypatch) -> None:
    record = with_a_line(20 * NOISE)
    problem = Problem(record, DEVICE, SETTINGS)
    line = {"omega": OMEGA + 0.3 / (len(record) / DEVICE.sample_rate)}
    started = fit(problem.carrying({"interference": line}))
    counted: list[int] = []

    def counting(*args, **keys):
        counted.append(1)
        return fit(*args, **keys)

    monkeypatch.setattr("estimator.trace.parameters.fit", counting)
    refine_parameters(problem, started, "interference")
    needed = len(counted)
    counted.clear()
    refine_parameters(problem, started, "interference", to_beat=started.likelihood + 1e7)
    assert 3 <= len(counted) < needed
    told = []
    model = ObserverModel(problem, lambda *what: told.append(what))
    base = Carrying(problem, fit(problem))
    look = SimpleNamespace(watched={"sense_gain": {}, "interference:1": line}, evidence={})
    model.fit(base, look, list(look.watched), {})
    assert told == [("candidates", 1, 2), ("candidates", 2, 2), ("parameters", 1, 1)]
