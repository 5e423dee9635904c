"""The figures of a row, counted by hand: docs/reference/compare.md (Columns)."""

import numpy as np
import pytest

from hil.comparing.course import Judge, MethodCourse, Reference

TICK = np.arange(1000)
TRUE = Reference("truth", TICK, 1e-2 * TICK, np.ones(1000), {"kxx": 10.0, "kyy": 10.0, "kxy": 0.0})
JUDGE = Judge(100.0, 5.0, 10.0)


def course(error: np.ndarray, **changes: object) -> MethodCourse:
    return MethodCourse("a method", "observer", TICK, 1e-2 * TICK + error, **changes)


def test_figures_of_a_row_by_hand() -> None:
    error = np.where(TICK < 300, 0.5, 0.1)
    error[600:] += 0.01
    row = JUDGE.row(course(error, rate=np.full(1000, 1.25), parameters={"kxx": 13.0, "kyy": 10.0, "kxy": 4.0}), TRUE)
    assert row.angle_error_rms_rad == pytest.approx(0.01 * np.sqrt(0.8))
    assert row.angle_error_max_rad == pytest.approx(0.01)
    assert row.rate_error_rms_rad_s == pytest.approx(0.25)
    assert row.stiffness_error == pytest.approx(np.sqrt(25.0 / 3.0) / 10.0)
    assert row.settled_s == pytest.approx(3.0)
    assert row.diverged_s is None
    assert row.angle_rad == pytest.approx(1e-2 * 499 + 0.01)


def test_a_divergence_is_told_by_when_it_began() -> None:
    away = np.where(TICK < 700, 0.0, 3.0)
    assert JUDGE.row(course(away), TRUE).diverged_s == pytest.approx(7.0)
    back = np.where((TICK > 700) & (TICK < 800), 3.0, 0.0)
    assert JUDGE.row(course(back), TRUE).diverged_s is None
    lost = np.where(TICK < 400, 0.0, np.nan)
    row = JUDGE.row(course(lost), TRUE)
    assert row.diverged_s == pytest.approx(4.0)
    assert (row.angle_error_rms_rad, row.settled_s) == (None, None)
    assert JUDGE.row(course(np.zeros(1000), lost_tick=650), TRUE).diverged_s == pytest.approx(6.5)
