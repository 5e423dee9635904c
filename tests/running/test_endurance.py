"""The long run that survives a kill: what it is made of, short."""

import re
from pathlib import Path

import pytest

from benchmarks import endurance


@pytest.mark.long
def test_a_resumed_run_has_the_hashes_of_one_that_was_not_stopped(tmp_path: Path) -> None:
    whole = endurance.endure(tmp_path / "whole", 200_000, 50_000, lambda _: None)
    endurance.endure(tmp_path / "parts", 100_000, 50_000, lambda _: None)
    said: list[str] = []
    parts = endurance.endure(tmp_path / "parts", 200_000, 50_000, said.append)
    assert said[0].startswith("going on from 100,000 samples")
    assert [mark.hash for mark in parts] == [mark.hash for mark in whole]
    assert len({mark.hash for mark in whole}) == 4
    assert all(mark.smallest_eigenvalue > 0.0 and mark.asymmetry == 0.0 and mark.lost == 0 for mark in whole)


@pytest.mark.moderate
def test_a_snapshot_that_was_not_finished_leaves_the_one_before(tmp_path: Path) -> None:
    endurance.endure(tmp_path, 50_000, 50_000, lambda _: None)
    (tmp_path / f"{endurance.SNAPSHOT}.tmp").write_bytes(b"half a snapshot")
    restored = endurance.restored(tmp_path)
    assert restored is not None
    assert restored[0].samples == 50_000


@pytest.mark.long
def test_energy_leaves_out_what_was_before_the_loop_had_settled(tmp_path: Path) -> None:
    marks = endurance.endure(tmp_path, 300_000, 150_000, lambda _: None)
    assert marks[0].energy_worst == 0.0
    assert 0.0 < marks[1].energy_rms < marks[1].energy_worst < 0.01


def test_hashes_are_chained_from_stretch_to_stretch() -> None:
    one, other = endurance.Chain(), endurance.Chain()
    one.put(1.0, 2.0)
    other.put(1.0, 3.0)
    assert one.mark() != other.mark()
    before = one.digest
    one.put(1.0)
    other.put(1.0)
    assert one.mark() != other.mark()
    assert before != one.digest
    assert re.fullmatch("[0-9a-f]{32}", one.mark())


@pytest.mark.parametrize("value", [1e9, 3.5])
def test_a_chain_takes_rows_of_any_length(value: float) -> None:
    chain = endurance.Chain()
    for _ in range(20_000):
        chain.put(value, value, value, value)
    assert len(chain.mark()) == 32
