"""`hil generate --float32`: what 32 bits round off does not add up in the angle."""

from pathlib import Path

import numpy as np
import pytest

from evaluation.two_loops import TURNS, Generated, apart, closed_by, scenario, written

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_sizes")]


def test_in_ten_turns_its_angle_is_that_of_double(tmp_path: Path) -> None:
    """Of the same samples, of a loop that it closes itself."""
    short, double = (written(tmp_path / str(bits), float32=bits == 32) for bits in (32, 64))
    angles = closed_by(Generated(short), scenario(), Generated(double))
    assert angles[-1, 1] / (2.0 * np.pi) == pytest.approx(TURNS, abs=0.05)
    assert np.abs(apart(angles[:, 0], angles[:, 1])).max() < 1e-4


def test_ten_turns_of_its_own_loop_are_those_of_a_loop_in_double(tmp_path: Path) -> None:
    """With a converter of 24 bits: the rounding of 16 alone takes two loops in double as far apart."""
    short, double = (written(tmp_path / str(bits), float32=bits == 32, sense_bits=24) for bits in (32, 64))
    board = scenario(24)
    angles = [closed_by(Generated(library), board)[:, 0] for library in (short, double)]
    assert np.abs(apart(*angles)).max() < 1e-4
