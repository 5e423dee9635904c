"""A threshold that every drive passes, or none, is no threshold."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.scaling import Array
from estimator.trace import nested
from estimator.trace.criterion import TIE
from estimator.trace.engine import Score, Trial
from estimator.trace.nested import simpler_by_standing, simpler_in, turned_into, with_simpler
from estimator.trace.problem import Problem
from tests.estimator.test_scan import DEVICE, OMEGA0, SETTINGS, record

CODE = 3e-4  # of a converter
CODES = np.array([[0, 5], [-3, 400], [1, -2], [7, 0]])


def problem(gain: float = 1.0):
    drive = (CODES * CODE / gain)[:, :, None]
    return SimpleNamespace(record=SimpleNamespace(drive=drive), device=SimpleNamespace(drive_gain=gain))


@pytest.mark.parametrize("gain", [1.0, 20.0])
@pytest.mark.parametrize(
    ("name", "parameter", "codes", "left"),
    [
        ("drive_saturation:2", "limit", 0.5, "drive gain"),
        ("drive_saturation:2", "limit", 0.999, "drive gain"),
        ("drive_saturation:2", "limit", 1.0, "drive gain"),
        ("drive_dead_band:4", "band", 1.0, "no effect at all"),
        ("drive_dead_band:4", "band", 400.0, "drive gain"),
        ("drive_saturation", "limit", 1.5, None),
        ("drive_saturation", "limit", 500.0, None),
        ("drive_dead_band:4", "band", 0.5, "no effect at all"),
        ("drive_dead_band:4", "band", 1.5, None),
        ("drive_dead_band:4", "band", 399.0, None),
        ("drive_dead_band:4", "band", 401.0, "drive gain"),
        ("sense_clipping:1", "level", 0.5, None),
        ("sense_low_pass", "level", 0.0, None),  # a corner however far away: likelihoods decide
    ],
)
def test_what_is_left_of_a_threshold(gain, name, parameter, codes, left) -> None:
    assert turned_into(problem(gain), name, {parameter: codes * CODE}) == left


def test_a_drive_that_stops_below_a_code_is_one_of_another_gain() -> None:
    # The force that the declared drive lacks, with all of it lost over half a code, beside that of a gain of −s.
    u, s, limit = CODES * CODE, 0.3, 0.5 * CODE
    lost = s * (np.clip(u, -limit, limit) - u)
    assert np.max(np.abs(lost + s * u)) <= s * limit * (1.0 + 1e-9)
    assert turned_into(problem(), "drive_saturation", {"limit": limit}) == "drive gain"


def test_the_simpler_one_follows_once_and_only_where_it_is_watched() -> None:
    watched = ["drive_gain", "drive_saturation:1", "drive_dead_band:2", "sense_gain"]
    assert with_simpler(["drive_saturation:1", "drive_dead_band:2"], watched) == [*watched[1:3], "drive_gain"]
    assert with_simpler(["drive_gain", "drive_saturation:1"], watched) == ["drive_gain", "drive_saturation:1"]
    assert with_simpler(["drive_saturation:1"], watched[1:]) == ["drive_saturation:1"]
    assert with_simpler(["sense_gain"], watched) == ["sense_gain"]
    assert with_simpler(["sense_low_pass"], ["sense_delay", "sense_low_pass"]) == ["sense_low_pass", "sense_delay"]
    assert with_simpler(["sense_delay"], ["sense_delay", "sense_low_pass"]) == ["sense_delay"]


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


@pytest.mark.parametrize(("at", "is_itself"), [(0.5, False), (0.99, True), (1.0, True), (1.01, True), (1.6, False)])
def test_a_mode_that_ends_at_the_resonance_is_the_gyro_itself(at: float, *, is_itself: bool) -> None:
    left = turned_into(Problem(record(), DEVICE, SETTINGS), "parasitic_mode:1", {"omega": at * OMEGA0, "zeta": 1e-3})
    assert (left == "the gyro itself, its drive of another gain") is is_itself


def test_a_mode_is_asked_about_by_its_frequency(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def at_resonance(record: object, device: object, omega: Array) -> Array:
        asked.append((record, device, omega.tolist()))
        return omega < 100.0

    monkeypatch.setattr(nested, "at_resonance", at_resonance)
    given = problem()
    for omega, left in ((99.0, "the gyro itself, its drive of another gain"), (101.0, None)):
        assert turned_into(given, "parasitic_mode:3", {"omega": omega, "zeta": 1e-3}) == left
        assert asked[-1] == (given.record, given.device, [omega])


def test_where_nothing_drives_no_threshold_is_passed_and_a_dead_band_holds_all() -> None:
    """A limit that no drive reaches does nothing; of no drive a band takes all, which is no effect at all."""
    still = problem()
    still.record.drive[:] = 0.0
    assert turned_into(still, "drive_saturation", {"limit": CODE}) == "drive gain"
    assert turned_into(still, "drive_dead_band", {"band": CODE}) == "no effect at all"


def test_what_another_is_at_the_end_of_its_range_counts_where_it_is_watched() -> None:
    look: Any = SimpleNamespace(watched={"drive_gain": {}, "sense_delay": {}})
    assert simpler_in("drive_saturation:2", look) == "drive_gain"
    assert simpler_in("quintic_stiffness", look) is None
    assert simpler_in("drag", look) is None
