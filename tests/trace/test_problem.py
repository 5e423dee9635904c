"""A problem and the ways in which it is made another: each changes one thing and leaves the rest and itself."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.record import Record
from estimator.settings import ControllerSettings, ObserverSettings
from estimator.trace.problem import Problem
from tests.estimator.device import NOMINAL

RECORD = Record(np.arange(16.0).reshape(8, 2), np.zeros((8, 2, 1)), np.array([0.25] * 4 + [0.5] * 4))
SETTINGS = ObserverSettings(memory=7.0, effects={"drag": {"dqx": 1.0}})
LAW = ControllerSettings(3, 1e-3, 1.0, 1e-5)
PROBLEM = Problem(RECORD, NOMINAL, SETTINGS, LAW)


def test_what_is_carried_is_what_the_observer_is_set_to_carry() -> None:
    assert PROBLEM.effects == {"drag": {"dqx": 1.0}}


def test_its_span_is_the_sum_of_its_steps() -> None:
    assert PROBLEM.span == pytest.approx(3.0)


def test_a_part_of_it_has_these_samples_only() -> None:
    part = PROBLEM.part(slice(2, 5))
    np.testing.assert_array_equal(part.record.sense, RECORD.sense[2:5])
    assert replace(part, record=RECORD) == PROBLEM


def test_it_can_be_of_another_record() -> None:
    other = RECORD.part(slice(0, 3))
    assert PROBLEM.on(other) == replace(PROBLEM, record=other)


def test_it_can_be_under_another_observer() -> None:
    other = ObserverSettings(memory=9.0)
    assert PROBLEM.under(other) == replace(PROBLEM, settings=other)
    assert PROBLEM.under(other).effects == {}


def test_it_can_carry_other_effects_which_are_its_own_from_then_on() -> None:
    given = {"drive_gain": {"hx": 0.1}}
    carrying = PROBLEM.carrying(given)
    assert carrying == replace(PROBLEM, settings=replace(SETTINGS, effects={"drive_gain": {"hx": 0.1}}))
    given["drive_gain"]["hx"] = 0.7
    assert carrying.effects == {"drive_gain": {"hx": 0.1}}
    assert PROBLEM.effects == {"drag": {"dqx": 1.0}}
