"""A carriage made here by small steps of its own: output error must give back its friction and where that falls."""

import math

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.record import Record
from evaluation.measured.carriage import fitted, turnover, with_stribeck
from evaluation.measured.inverse_dynamics import Filters, motion_of
from evaluation.measured.oscillator import declared

N, STEP, FINE = 4000, 1e-3, 20
GAIN, VISCOUS, DRY, STATIC, FALL, REST = 1 / 95.0, 2.1, 0.22, 0.15, 20e-3, 1e-3
CONSTANTS = {"dxx": 2.0, "drive_gain_x": 1 / 97.0}
EFFECTS = {"constant_force": {"ax": 0.0}, "dry_friction": {"fx": 0.2, "v0": REST}}


@pytest.fixture(scope="module")
def record() -> Record:
    """From rest, there and back under forces that grow and fall; the force is held between samples."""
    time = np.arange(N) * STEP
    force = 60.0 * np.sin(2.0 * math.pi * 0.8 * time) + 25.0 * np.sin(2.0 * math.pi * 0.3 * time)
    x, v, shown = 0.0, 0.0, [0.0]
    h = STEP / FINE
    for given in force[1:].tolist():
        for _ in range(FINE):
            half = v
            for _ in range(2):  # the implicit midpoint, by two rounds
                mean = 0.5 * (v + half)
                friction = (DRY + STATIC * math.exp(-((mean / FALL) ** 2))) * math.tanh(mean / REST)
                half = v + h * (GAIN * given - VISCOUS * mean - friction)
            x += 0.5 * h * (v + half)
            v = half
        shown.append(x)
    noise = 1e-6 * np.random.default_rng(1).standard_normal(N)
    return Record((np.array(shown) + noise)[:, None], force[:, None, None], np.full(N, STEP))


@pytest.mark.long
def test_friction_that_falls_with_the_speed_is_found_with_its_speed(record: Record) -> None:
    device, settings = declared("emps")
    plain = fitted(device, settings, record, CONSTANTS, EFFECTS)
    full = with_stribeck(device, settings, record, CONSTANTS, EFFECTS)
    assert full.physical
    assert full.rmse < 0.1 * plain.rmse
    assert full.observer.settings.effects["stribeck_friction"]["vs"] == pytest.approx(FALL)  # one of the speeds tried
    for name, true in (("stx", STATIC), ("fx", DRY), ("dxx", VISCOUS), ("drive_gain_x", GAIN)):
        assert full.fit.value(name) == pytest.approx(true, rel=0.03), name
    assert np.sqrt(np.mean(full.error_on(record, 20) ** 2)) < 1.1 * full.rmse


def test_a_carriage_turns_over_within_what_its_velocity_changes_by() -> None:
    time = np.arange(4000) * STEP
    there = motion_of(0.1 * np.sin(2.0 * math.pi * time), np.zeros(4000), 1.0 / STEP, Filters(60.0, 20.0, 25))
    assert turnover(there) == pytest.approx(0.1 * (2.0 * math.pi) ** 2 * STEP, rel=0.01)
    away = motion_of(0.1 * time + 1e-3 * time**2, np.zeros(4000), 1.0 / STEP, Filters(60.0, 20.0, 25))
    with pytest.raises(ModelError, match="never turns"):
        turnover(away)
