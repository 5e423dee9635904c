"""The tables of an experiment: no longer than is told beforehand, no drive beyond the largest."""

import numpy as np
import pytest

from estimator.identify.schedule import LENGTHS, Known, Lengths, measurement, search

_SHORT = Lengths(100, 200, 50, 60, 80, (70, 90), (110, 130))


@pytest.mark.parametrize("lengths", [LENGTHS, _SHORT])
def test_no_table_is_longer_than_told_beforehand(lengths: Lengths) -> None:
    assert len(search(2.0, lengths).forces) == lengths.search
    rows = []
    for decay in (0.0, 1e-5, 1e-3, 1e-2, 1.0):
        known = Known(np.array([0.31, 0.32]), decay, np.array([1e-3, -1e-3]))
        rows.append(len(measurement(known, 2.0, np.array([0.1, 0.1]), lengths).forces))
    assert rows[0] == max(rows) == lengths.measurement
    assert rows[-1] < rows[0]


@pytest.mark.parametrize("decay", [1e-6, 1e-2])
def test_no_drive_is_beyond_the_largest(decay: float) -> None:
    known = Known(np.array([0.31, 0.32]), decay, np.array([1e-3, -1e-3]))
    for limit_V in (1e-4, 1e4):
        for table in (search(2.0, LENGTHS), measurement(known, 2.0, np.full(2, limit_V), LENGTHS)):
            assert 0.0 < np.abs(table.forces).max() <= 2.0
