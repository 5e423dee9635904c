"""A threshold that every drive passes, or none, is no threshold."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.trace.criterion import TIE
from estimator.trace.engine import Score, Trial
from estimator.trace.nested import simpler_by_standing

CODE = 3e-4  # of a converter
CODES = np.array([[0, 5], [-3, 400], [1, -2], [7, 0]])


def problem(gain: float = 1.0):
    drive = (CODES * CODE / gain)[:, :, None]
    return SimpleNamespace(record=SimpleNamespace(drive=drive), device=SimpleNamespace(drive_gain=gain))


@pytest.mark.parametrize(
    ("best", "other", "lead", "price", "found"),
    [
        ("sense_low_pass", "sense_delay", 0.9 * TIE, 0.0, "sense_delay"),
        ("sense_low_pass", "sense_delay", 1.1 * TIE, 0.0, None),
        ("sense_low_pass", "sense_delay", 0.9 * TIE, 0.2 * TIE, None),  # what the simpler one costs counts against it
        ("sense_low_pass", "sense_delay", 1.1 * TIE, -0.2 * TIE, "sense_delay"),
        ("sense_delay", "sense_low_pass", 0.1 * TIE, 0.0, None),  # the other way there is none
        ("drive_saturation:2", "drive_gain", 0.9 * TIE, 0.0, "drive_gain"),
        ("sense_low_pass", "drive_gain", 0.1 * TIE, 0.0, None),
        ("sense_gain", "drive_gain", 0.1 * TIE, 0.0, None),
    ],
)
def test_the_simpler_one_stands_for_what_is_not_told_from_it(best, other, lead, price, found) -> None:
    trials = {
        best: Trial(None, Score(900.0, 900.0, 10.0, 9.0)),
        other: Trial(None, Score(900.0 - lead, 0.0, 10.0 + price, 9.0)),
    }
    assert simpler_by_standing(best, trials) == found
    assert simpler_by_standing(best, {best: trials[best]}) is None
