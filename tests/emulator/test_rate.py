"""Rate profiles: values, derivative and integral belong together, and a bad file says where."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy.integrate import quad

from device_emulator.rate import Rate, pieces, rate_at
from device_emulator.section import ScenarioError


def profile(table: dict[str, Any]) -> Any:
    return pieces(TypeAdapter(Rate).validate_python(table))


def piece_at(table: Any, t_s: float) -> Any:
    return table[np.searchsorted(table["start_s"], t_s, side="right") - 1]


def value(table: Any, t_s: float) -> float:
    return rate_at(piece_at(table, t_s), t_s)[0]


SEGMENTS = {
    "kind": "segments",
    "segment": [
        {"kind": "constant", "duration_s": 0.3, "rate_rad_s": 2.0},
        {"kind": "ramp", "duration_s": 0.4, "from_rad_s": 2.0, "to_rad_s": -1.0},
        {"kind": "sine", "duration_s": 0.5, "amplitude_rad_s": 1.5, "frequency_Hz": 3.0, "offset_rad_s": 0.2},
        {"kind": "ramp", "duration_s": 0.2, "from_rad_s": 0.0, "to_rad_s": 4.0},
    ],
}
PROFILES: list[dict[str, Any]] = [
    {"kind": "constant", "rate_rad_s": -1.5},
    {"kind": "steps", "times_s": [0.0, 0.5, 0.75], "rates_rad_s": [1.0, -2.0, 0.5]},
    {"kind": "sine", "amplitude_rad_s": 2.0, "frequency_Hz": 1.7, "phase_rad": 0.4, "offset_rad_s": -0.3},
    {"kind": "ramp", "duration_s": 0.8, "from_rad_s": 1.0, "to_rad_s": 5.0},
    SEGMENTS,
]


@pytest.mark.parametrize("table", PROFILES, ids=lambda t: t["kind"])
def test_angle_is_the_integral_and_slope_the_derivative(table: dict[str, Any]) -> None:
    rows = profile(table)
    starts = [*rows["start_s"], 2.0]
    total = 0.0
    for piece, begin, end in zip(rows, starts, starts[1:], strict=False):
        middle = 0.5 * (begin + end)
        rate, slope, angle = rate_at(piece, middle)
        assert rate == pytest.approx(value(rows, middle), abs=1e-15)
        step = 1e-6
        assert slope == pytest.approx(
            (rate_at(piece, middle + step)[0] - rate_at(piece, middle - step)[0]) / (2 * step), abs=1e-6
        )
        assert angle == pytest.approx(
            total + quad(lambda t, p=piece: rate_at(p, t)[0], begin, middle, epsabs=1e-13)[0], abs=1e-12
        )
        total += quad(lambda t, p=piece: rate_at(p, t)[0], begin, end, epsabs=1e-13)[0]


def test_segments_follow_one_another() -> None:
    rows = profile(SEGMENTS)
    assert value(rows, 0.1) == 2.0
    assert value(rows, 0.3 + 0.1) == pytest.approx(2.0 - 3.0 * 0.25)
    assert value(rows, 0.7 + 0.05) == pytest.approx(0.2 + 1.5 * np.sin(2 * np.pi * 3.0 * 0.05))
    assert value(rows, 1.2 + 0.1) == pytest.approx(2.0)
    assert value(rows, 100.0) == 4.0


def test_a_single_ramp_holds_its_end() -> None:
    assert value(profile(PROFILES[3]), 0.4) == pytest.approx(3.0)
    assert value(profile(PROFILES[3]), 9.0) == 5.0


def test_a_file_is_linear_between_its_rows(tmp_path: Path) -> None:
    path = tmp_path / "rate.csv"
    path.write_text("t_s, rate_rad_s\n0, 0\n0.5, 1\n1.0, -1\n")
    rows = profile({"kind": "file", "path": str(path)})
    assert [value(rows, t) for t in (0.0, 0.25, 0.5, 0.75, 1.0, 7.0)] == pytest.approx([0, 0.5, 1, 0, -1, -1])
    assert rate_at(rows[-1], 2.0)[2] == pytest.approx(0.25 + 0.0 - 1.0)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("time, rate\n0, 1\n", "csv:1: expected the header `t_s, rate_rad_s`, or `t_s, rate_dps`"),
        ("", "csv:1: expected the header `t_s, rate_rad_s`, or `t_s, rate_dps`"),
        ("t_s, rate_rad_s\n0, 1\n1, two\n", "csv:3: expected two numbers, t_s and rate_rad_s"),
        ("t_s, rate_rad_s\n0, 1\n1\n", "csv:3: expected two numbers, t_s and rate_rad_s"),
        ("t_s, rate_rad_s\n0, 1\n1, nan\n", "csv:3: expected finite numbers"),
        ("t_s, rate_rad_s\n0, 1\n0, 2\n", "csv:3: expected t_s to increase, 0 follows 0"),
        ("t_s, rate_rad_s\n1, 1\n", "csv: expected rows that begin at t_s = 0"),
        ("t_s, rate_rad_s\n", "csv: expected rows that begin at t_s = 0"),
    ],
)
def test_a_bad_file_says_where(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "rate.csv"
    path.write_text(text)
    with pytest.raises(ScenarioError) as caught:
        profile({"kind": "file", "path": str(path)})
    assert str(caught.value).endswith(complaint)


def test_a_missing_or_binary_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"cannot read the rate file \(No such file or directory\)$"):
        profile({"kind": "file", "path": str(tmp_path / "none.csv")})
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match=r"expected a CSV text file$"):
        profile({"kind": "file", "path": str(tmp_path / "binary.csv")})
