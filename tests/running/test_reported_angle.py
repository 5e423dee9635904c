"""The rows of the reported angle: one zero for the angle and its uncertainty, and every source in every row.

docs/decisions/0005-reported-angle.md, docs/explanation.md (What the angle is uncertain by).
"""

import math
from typing import Any

import numpy as np
import pytest

from hil.bench import Bench
from hil.running.recording.angle import ReportedAngle
from hil.verdict.budget import budget
from tests.running import gyro
from tests.verdict.gyro_estimates import DXX, DXY, DYY, KXY, SETTLE_S, estimates

T = np.arange(101) / 10.0
ANGLE, FORCED, DEVIATION = 7.0 + 0.5 * T, 3.0 * T, np.where(T < SETTLE_S, 0.1, 1e-3)


def bench(**changes: Any) -> Bench:
    return gyro.bench(10.0, loop={"settle_s": SETTLE_S}, **changes)


def followed(declared: Bench, parts: int = 1, begin_s: float = 0.0) -> tuple[list[np.ndarray], np.ndarray]:
    """The rows of ten seconds from bench time `begin_s` on, told in so many parts."""
    reported, told = ReportedAngle(declared), []
    for rows in np.array_split(np.arange(101), parts):
        constants = np.full(len(rows), KXY), tuple(np.full(len(rows), d) for d in (DXX, DYY, DXY))
        told.append(reported.follow(begin_s + T[rows], (ANGLE[rows], FORCED[rows]), DEVIATION[rows], *constants))
    angles = [np.concatenate([part[0][k] for part in told]) for k in range(2)]
    return angles, np.concatenate([part[1] for part in told])


def test_angle_and_uncertainty_have_one_zero() -> None:
    """Before the scored window both count from the first row; from its start on, both from there."""
    (angle, forced), u = followed(bench())
    scored = T >= SETTLE_S
    first = int(np.argmax(scored))
    np.testing.assert_allclose(angle[~scored], 0.5 * T[~scored])
    np.testing.assert_allclose(angle[scored], 0.5 * (T[scored] - SETTLE_S), atol=1e-12)
    np.testing.assert_allclose(forced[scored], 3.0 * (T[scored] - SETTLE_S), atol=1e-12)
    assert (angle[0], angle[first]) == (0.0, 0.0)
    assert u[first] == pytest.approx(1e-3)  # nothing but the estimation of that very row
    assert np.all(np.diff(u[first:]) > 0.0)


@pytest.mark.parametrize("begin_s", [0.025, 3.0, 4321.5])
@pytest.mark.parametrize("parts", [1, 101])
def test_a_run_that_begins_late_in_the_board_s_time_settles_first(begin_s: float, parts: int) -> None:
    """The second run of a board that goes on counting its samples: as the first, row by row."""
    first, u = followed(bench())
    later, later_u = followed(bench(), parts, begin_s)
    for one, other in zip(first, later, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    np.testing.assert_allclose(u, later_u, rtol=1e-9)


@pytest.mark.parametrize("parts", [2, 7, 101])
def test_rows_may_come_in_any_parts(parts: int) -> None:
    for whole, cut in zip(followed(bench()), followed(bench(), parts), strict=True):
        np.testing.assert_array_equal(whole, cut)


def test_one_row_at_a_time() -> None:
    (angles, u), reported = followed(bench()), ReportedAngle(bench())
    for row in range(101):
        at = slice(row, row + 1)
        (angle, forced), one = reported.follow(T[at], (ANGLE[at], FORCED[at]), DEVIATION[at], KXY, (DXX, DYY, DXY))
        assert (angle[0], forced[0], one[0]) == pytest.approx((angles[0][row], angles[1][row], u[row]))


@pytest.mark.parametrize("variant", ["full", "gyro", "sense"])
@pytest.mark.parametrize("controlled", [True, False])
def test_the_last_row_is_the_budget_of_the_end_before_its_scan(variant: str, controlled: bool) -> None:
    """Every source in both: what was told while it ran is what the end says, as declared."""
    declared = bench(observer={"variant": variant}, controller={"enabled": controlled})
    angles, u = followed(declared)
    found = estimates(angle_rad=angles[0], angle_forced_rad=angles[1], angle_u_rad=u, angle_sd_rad=DEVIATION)
    done = budget(found, declared)
    assert done.angle_u_rad == pytest.approx(u[-1])
    rows = {row.source: row.declared_rad for row in done.uncertainty}
    assert ("declared damping" in rows) == (variant == "sense")
    assert math.hypot(*(value or 0.0 for value in rows.values())) == pytest.approx(u[-1])
