"""What the budget proposes to lower its rows lowers them when it is followed (docs/how-to.md)."""

import re
from pathlib import Path
from typing import Any

import pytest

from hil.bench import Bench, override
from hil.records.result import Result, load_result
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from hil.verdict.angle import remedy
from tests.running import gyro

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("no_report")]

EXACT = {
    "angular_gain_u": 0.0, "clock_u": 0.0, "drive_gain_u": 0.0, "drive_misalignment_u": 0.0, "drive_delay_u_s": 0.0,
    "sense_gain_ratio_u": 0.0, "sense_cross_coupling_u": 0.0, "sense_delay_u_s": 0.0,
}  # fmt: skip


def of(bench: Bench, tmp_path: Path) -> Result:
    scenario = gyro.scenario(tmp_path / "board.toml")
    done = run(RunRequest(bench, f"inproc:{scenario}"), tmp_path / "runs", progress=lambda _: None)
    assert done.folder is not None
    return load_result(RunFolder(done.folder).result_path)


def followed(bench: Bench, advice: str) -> Bench:
    """The bench with the first key that the advice sets."""
    found = re.search(r"\[([\w.]+)\] (\w+) = ([-+\d.e]+)", advice)
    assert found is not None, advice
    section, key, value = found.groups()
    changes: dict[str, Any] = {key: float(value)}
    for name in reversed(section.split(".")):
        changes = {name: changes}
    return override(bench, changes, "followed")


@pytest.mark.parametrize(
    ("source", "declared"),
    [
        ("drive gain", {"controller": {"virtual_reversal_s": 0.0}}),
        ("estimation", {"device": {"calibration": EXACT}}),
        ("undeclared effects", {"device": {"calibration": EXACT}, "controller": {"virtual_rotation_rad_s": 1.0}}),
        ("clock", {"device": {"calibration": EXACT | {"clock_u": 0.01}}, "controller": {"virtual_reversal_s": 0.0}}),
    ],
)
def test_a_row_is_lowered_by_what_is_proposed(tmp_path: Path, source: str, declared: dict[str, Any]) -> None:
    bench = gyro.bench(6.0, **declared)
    rows = {row.source: row for row in of(bench, tmp_path).uncertainty}
    better = followed(bench, remedy(rows[source], bench).text)
    lowered = {row.source: row for row in of(better, tmp_path).uncertainty}
    assert lowered[source].contribution_rad < 0.9 * rows[source].contribution_rad, remedy(rows[source], bench).text
