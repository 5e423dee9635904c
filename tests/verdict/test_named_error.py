"""U is never below an error that the verdict names beside it (docs/decisions/0019-closing-scan.md)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.numbers import COVERAGE
from hil.records.result import Lacking, Scan
from hil.verdict.budget import budget
from tests.verdict.gyro_estimates import estimates
from tests.verdict.test_budget_rows import bench, information

SIZES = st.floats(1e-6, 30.0)


def lacking(effect: str, angle_rad: float, alike: tuple[str, ...] = ()) -> Lacking:
    return Lacking(
        effect=effect, coefficients={}, angle_rad=angle_rad, angle_ci95=(0.9 * angle_rad, 1.1 * angle_rad), alike=alike
    )


def scanned(*, complete: bool, lacks: tuple[Lacking, ...] = (), harmless: tuple[Lacking, ...] = ()) -> Scan:
    return Scan(complete=complete, reason="", lacks=lacks, harmless=harmless, samples=1000, span_s=1.0, seconds=1.0)


@given(size=SIZES, small=SIZES, effect=st.sampled_from(["drive_saturation", "drive_gain", "sense_gain", "drive_delay"]))
def test_what_the_model_lacks_is_within_u(size: float, small: float, effect: str) -> None:
    scan = scanned(complete=False, lacks=(lacking(effect, size),), harmless=(lacking("cubic_stiffness", small),))
    for known in (None, information()):
        done = budget(estimates(), bench({}), known, scan)
        assert done.angle_expanded_rad is not None
        assert done.angle_expanded_rad >= COVERAGE * max(size, small)


@given(size=SIZES)
def test_so_is_what_is_there_and_not_held_against_the_run(size: float) -> None:
    """Found by the scan, included in its model, and no longer tested by it."""
    scan = scanned(complete=True, harmless=(lacking("drive_delay", size),))
    done = budget(estimates(), bench({}), information(), scan)
    assert done.angle_expanded_rad is not None
    assert done.angle_expanded_rad >= COVERAGE * size
    rows = {row.source: row for row in done.uncertainty}
    assert rows["drive delay"].contribution_rad == pytest.approx(np.hypot(size, 0.1 * size / 1.959964))


def test_a_constant_that_was_found_counts_once() -> None:
    """As what it was found to do, not as declared."""
    for declared, found in ((1e-3, 0.5), (0.05, 0.02)):
        scan = scanned(complete=False, lacks=(lacking("drive_gain", found),))
        alone = budget(estimates(), bench({"drive_gain_u": declared}))
        done = budget(estimates(), bench({"drive_gain_u": declared}), None, scan)
        rows, before = ({row.source: row for row in one.uncertainty} for one in (done, alone))
        assert set(rows) == set(before)
        expected = np.hypot(found, 0.1 * found / 1.959964)
        assert rows["drive gain"].contribution_rad == pytest.approx(expected)
        assert rows["drive gain"].declared_rad == before["drive gain"].contribution_rad
        assert [name for name, row in rows.items() if row.found] == ["drive gain"]
