"""docs/wire.md, "What a host does with what it hears", gain mode: which names of matrices are held against a board.

A block of 20 rows, answered by the matrix for the next tick; names are given from 1 to 255 and again.
"""

import pytest

from hil.running.loop.gain import SentMatrices

BLOCK = 20


def sent(count: int) -> SentMatrices:
    """So many, the k-th for tick 20 (k + 1)."""
    matrices = SentMatrices(BLOCK)
    for k in range(count):
        matrices.sent(BLOCK * (k + 1))
    return matrices


def verdict(matrices: SentMatrices, name: int, block: int) -> str:
    """What the k-th block is found to be once another one follows."""
    first = BLOCK * block
    assert matrices.named(name, first, first + BLOCK - 1) == ""
    return matrices.named(name, first + BLOCK, first + 2 * BLOCK - 1)


def test_a_host_that_lags_by_any_number_of_blocks_accuses_nobody() -> None:
    """What comes after 71 is 72, though 400 were sent meanwhile: as where a host answers a backlog block by block."""
    matrices = SentMatrices(BLOCK)
    lag = 400
    for k in range(3000):
        matrices.sent(BLOCK * (k + 1))
        if k >= lag:
            name = (k - lag) % 255 + 1
            assert matrices.named(name, BLOCK * (k - lag + 1), BLOCK * (k - lag + 2) - 1) == "", k


def test_matrices_that_never_arrived_are_passed_over() -> None:
    matrices = sent(254)
    assert matrices.named(1, 20, 39) == ""
    assert matrices.named(254, 20 * 254, 20 * 255 - 1) == ""


def test_one_that_was_not_sent_is_named() -> None:
    found = verdict(sent(70), 71, 100)
    assert found == "SENSE of tick 2019 names matrix 71; 70 were sent since ARM, the last is 70"
    assert "none was sent since ARM" in verdict(sent(0), 3, 5)


def test_one_that_was_replaced_is_not_in_force_again() -> None:
    matrices = sent(70)
    assert matrices.named(50, 1000, 1019) == ""
    assert "21 were sent from matrix 50, which was in force, on, the last is 70" in verdict(matrices, 49, 51)


def test_one_whose_tick_is_to_come_is_named() -> None:
    assert "names matrix 70, which is for tick 1400 and later" in verdict(sent(70), 70, 60)
    assert verdict(sent(70), 70, 70) == ""


def test_an_effect_that_starts_within_a_block_is_named_by_each_part() -> None:
    """On CAN a block comes in several SENSE."""
    matrices = sent(1)
    assert matrices.named(1, 14, 16) == ""
    assert matrices.named(1, 17, 19) == ""
    assert matrices.named(1, 20, 22) == ""


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_the_block_in_which_a_board_stops_is_not_held_against_it(parts: int) -> None:
    matrices = sent(10)
    assert matrices.named(5, 100, 119) == ""
    n = BLOCK // parts
    for part in range(parts):
        assert matrices.named(0, 120 + part * n, 120 + (part + 1) * n - 1) == ""
    assert matrices.named(0, 140, 139 + n) == f"SENSE of tick {119 + n} names no matrix; 5 was in force"


def test_what_was_sent_before_arm_is_forgotten() -> None:
    matrices = sent(10)
    assert matrices.named(5, 100, 119) == ""
    assert matrices.named(0, 120, 139) == ""
    matrices.forget()
    assert matrices.named(0, 400, 419) == ""
    matrices.sent(440)
    assert matrices.named(11, 440, 459) == ""
    matrices.forget()
    assert "none was sent since ARM" in verdict(matrices, 11, 30)
