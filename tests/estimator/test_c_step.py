"""The observer beside a step written by hand in C, which shares no line with the kernels: `benchmarks/speed/step.c`."""

import pytest

from benchmarks.speed import ALIKE
from benchmarks.speed.cases import CASES, Case
from benchmarks.speed.peers import HandWritten, compiler

IN_C = [  # a step of its own is compiled first
    pytest.param(case, id=case.name, marks=[pytest.mark.long] if case.effects else []) for case in CASES
]


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("case", IN_C)
def test_angle_state_and_deviations_are_those_of_the_step_in_c(case: Case) -> None:
    hand = HandWritten.built(case)
    assert hand is not None
    assert hand.apart(case) < ALIKE
