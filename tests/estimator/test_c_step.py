"""The peer of `python -m benchmarks speed` that is written by hand in plain C does what the observer does."""

import pytest

from benchmarks.speed.cases import CASES, Case
from benchmarks.speed.peers import HandWritten


@pytest.mark.parametrize("case", [case for case in CASES if not case.effects], ids=lambda case: case.name)
def test_the_step_by_hand_is_the_observers(case: Case) -> None:
    """Angle, state and deviations after 2000 samples, within a millionth of a deviation."""
    assert HandWritten(case).apart() < 1e-6
