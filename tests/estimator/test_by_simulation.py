"""Effects named by the free run, on records made by an independent integrator."""

import re

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.diagnosis import Verdict
from estimator.identification.problem import Problem
from estimator.record import Record
from estimator.settings import Device, ObserverSettings, Spread
from estimator.trace.by_simulation import trace_by_simulation
from estimator.trace.free_run import trace_free_run
from estimator.trace.free_run_model import candidates
from tests.estimator.test_simulation import RATE, SINGLE, integrated, noise_drive

SETTINGS = ObserverSettings(spread=Spread(offset=0.01))


def made(more, samples, seed=1, start=(0.0, 0.0), push=1.5e4):
    """Record of a driven or free oscillator with a further force per mass more(x, v)."""
    drive = noise_drive(samples, 1, push)
    steps = np.full(samples, 1.0 / RATE)

    def field(m, t, s):
        return [s[1], drive[m, 0] - 41.0 * s[1] - 1.92e5 * s[0] + more(*s)]

    states = integrated(field, start, steps)
    noise = np.random.default_rng(seed).standard_normal((samples, 1))
    return Record(2.0 * states[:, :1] + 0.004 + 1e-4 * noise, drive[:, :, None], steps)


def quiet(what, done, total):
    assert done <= total, what


@pytest.mark.long
def test_what_was_put_in_is_named_and_measured():
    record = made(lambda x, v: -7e5 * x**3 - 3e4 * x**2, 900)
    found = trace_by_simulation(Problem(record, SINGLE, SETTINGS), 0, quiet)
    assert set(found.effects) == {"cubic_stiffness", "quadratic_stiffness"}
    for name, value in (("k3x", 7e5), ("k2x", 3e4)):
        low, high = found.after.interval(name)
        assert low - 0.01 * value < value < high + 0.01 * value
    assert found.after.rmse[0] == pytest.approx(1e-4, rel=0.08)
    assert found.before.rmse[0] > 5.0 * found.after.rmse[0]
    assert "cubic_isotropic" in {other for taken, other, _ in found.alike if taken == "cubic_stiffness"}


@pytest.mark.slow
def test_a_record_that_lacks_nothing_is_given_nothing():
    for seed in (1, 2, 4):  # 3 is that of the drive: noise that is the drive again would be feedthrough
        found = trace_by_simulation(Problem(made(lambda x, v: 0.0, 900, seed), SINGLE, SETTINGS), 0, quiet)
        assert found.effects == ()
        assert found.after is found.before


@pytest.mark.slow
def test_two_unequal_masses_act_like_several_things_and_all_are_listed():
    """Springs of 31, 55 and 34 between walls and masses of 1 and 2.4, let go: a stiffness that is not symmetric, or
    (equal masses in other units) a sense gain.
    """
    step, samples = 1.0 / 30.0, 500
    between, masses = 55.0, (1.0, 2.4)
    stiffness = np.array([[31.0 + between, -between], [-between, 34.0 + between]]) / np.array(masses)[:, None]
    motion = expm(step * np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -0.02 * np.eye(2)]]))
    states = [np.array([90.0, -40.0, 30.0, 100.0])]
    for _ in range(samples - 1):
        states.append(motion @ states[-1])
    sense = np.array(states)[:, :2] + np.random.default_rng(3).standard_normal((samples, 2))
    track = Device(
        sample_rate=30.0, stiffness=(86.0, 37.0, -39.0), damping=(0.02, 0.02, 0.0), amplitude=100.0,
        sense_gain=(1.0, 1.0), noise=(1.0, 1.0),
    )  # fmt: skip
    record = Record(sense, np.zeros((samples, 2, 1)), np.full(samples, step))
    settings = ObserverSettings(
        memory=2.0, spread=Spread(position=2.0, velocity=2.0, offset=1.0, stiffness=0.2, damping=1.0, rate=1e-6)
    )
    said = trace_free_run(Problem(record, track, settings), split=300)
    assert said.verdict in (Verdict.EXPLAINED, Verdict.PARTLY)
    (named,) = (effect.name for effect in said.effects)
    alike = {pair.other: pair.separate_by for pair in said.separations}
    assert {named, *alike} >= {"nonreciprocal_stiffness", "sense_gain", "unequal_masses"}
    declared = re.search(r"m = ([\d.]+)", alike["unequal_masses"])
    assert declared
    assert float(declared[1]) == pytest.approx(1.4, rel=0.03)


@pytest.mark.slow
def test_a_ring_down_names_what_it_shows():
    record = made(lambda x, v: -7e5 * x**3, 500, start=(0.12, 0.0), push=0.0)
    found = trace_by_simulation(Problem(record, SINGLE, SETTINGS), 0, quiet)
    assert found.effects[0] in ("cubic_stiffness", "cubic_isotropic")
    drawn = 1e-4 * np.random.default_rng(1).standard_normal(500)
    assert found.after.rmse[0] == pytest.approx(np.std(drawn), rel=0.03)


@pytest.mark.long
def test_friction_that_would_drive_is_not_called_friction():
    record = made(lambda x, v: 30.0 * np.tanh(v / (0.01 * 0.1 * np.sqrt(1.9e5))), 900)
    found = trace_by_simulation(Problem(record, SINGLE, SETTINGS), 0, quiet)
    assert "dry_friction" not in found.effects
    assert "negative fx" in found.rejected["dry_friction"]


def test_candidates_are_those_that_the_device_can_have():
    names = candidates(SINGLE, ObserverSettings(effects={"cubic_stiffness": {}}))
    assert "nonlinear_damping" in names
    assert not {"cubic_stiffness", "sense_gain", "nonreciprocal_stiffness"} & set(names)
