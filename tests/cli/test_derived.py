"""What a bench file comes to, and the questions about what is improbable: `--dry-run`, `hil init`, the report."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from hil.bench import Bench, examples, load_any_bench, load_bench
from hil.bench.derived import derived, figures_of
from hil.bench.improbable import questions
from hil.bench.template import template, values_of
from hil.numbers import quantity
from hil.records.runfolder import RunFolder
from hil.report.page import render
from hil.wire.spec import SPEC
from tests.cli.conftest import Hil
from tests.cli.test_bench_file import MINIMAL, bench_file
from tests.cli.test_field_units import SHEET
from tests.records.synthetic_run import Options, write_run

QUIET = MINIMAL.replace("full_scale = 10", "full_scale = 10\n[loop]\nclock = 'paced'")
IDENTITY = {"sense_scale_V": 1e-5, "sense_bits": 16, "drive_scale_mps2": 1e-3, "drive_bits": 16}


def of(folder: Path, text: str) -> Bench:
    return load_bench(bench_file(folder, text))


def test_the_figures_are_those_of_the_matrices(tmp_path: Path) -> None:
    text = MINIMAL.replace("[1e-3, 1.2e-3, 0.0]", "[1e-3, 1.2e-3, 1e-4]") + "[controller]\nvirtual_rotation_rad_s = 3\n"
    bench = of(tmp_path, text)
    found = figures_of(derived(bench, IDENTITY))
    stiffness, axes = np.linalg.eigh([[1.579e6, 1e4], [1e4, 1.6e6]])
    damping = np.linalg.eigvalsh([[1.0, 0.1], [0.1, 1.2]])
    f = np.sqrt(stiffness) / (2 * np.pi)
    assert found["resonance_Hz"] == pytest.approx(f.mean())
    assert found["resonances_Hz"] == pytest.approx(f[::-1])
    assert found["split_Hz"] == pytest.approx(f[1] - f[0])
    assert math.tan(math.radians(found["azimuth_deg"])) == pytest.approx(axes[1, 1] / axes[0, 1])
    assert found["decay_time_s"] == pytest.approx(2.0 / damping[::-1])
    assert found["q"] == pytest.approx(np.pi * f.mean() * 2.0 / damping[::-1])
    assert found["samples_per_cycle"] == pytest.approx(4000 / f.mean())
    assert found["amplitude_V"] == pytest.approx([0.089, 0.089])
    assert found["amplitude_codes"] == pytest.approx([8900, 8900])
    assert found["amplitude_of_range"] == pytest.approx(8900 / 32768)
    assert found["amplitude_over_noise_dB"] == pytest.approx(20 * math.log10(890))
    target = 0.5 * (1.579e6 + 1.6e6)
    assert found["drive_for_mismatch_mps2"] == pytest.approx(max(abs(stiffness - target)) * 1e-4)
    rest = max(damping) * math.sqrt(target) * 1e-4 + 2 * 3 * math.sqrt(target) * 1e-4
    assert found["drive_needed_of_limit"] == pytest.approx((max(abs(stiffness - target)) * 1e-4 + rest) / 10.0)
    assert found["drive_limit_codes"] == 9_999  # the double 1e-3 is a little more than a thousandth
    assert found["loop_rate_Hz"] == 4000


@pytest.mark.parametrize(("full_scale", "asked"), [(10.0, 0), (1000.0, 1), (1.0, 1)])
def test_a_full_scale_that_is_not_the_board_s_is_questioned(tmp_path: Path, full_scale: float, asked: int) -> None:
    bench = of(tmp_path, MINIMAL.replace("full_scale = 10", f"full_scale = {full_scale}"))
    board = IDENTITY | {"drive_scale_mps2": 10.0 / 2**15}
    where = f"[device.drive] full_scale: {quantity(full_scale, 'm/s²')} declared; the board's codes end at 10.0"
    assert sum(one.startswith(where) for one in questions(bench, board)) == asked
    assert figures_of(derived(bench, board))["drive_full_scale_of_board_mps2"] == pytest.approx(10.0)


def test_the_drive_limit_in_codes_has_a_negative(tmp_path: Path) -> None:
    """Full scale is 2^15 codes, and the largest code 2^15 − 1 (docs/wire.md)."""
    bench = of(tmp_path, MINIMAL)
    found = figures_of(derived(bench, IDENTITY | {"drive_scale_mps2": 10.0 / 2**15}))
    assert found["drive_limit_codes"] == 32_767


def test_in_gain_mode_the_loop_is_closed_once_a_block(tmp_path: Path) -> None:
    assert figures_of(derived(of(tmp_path, MINIMAL + '[loop]\nmode = "gain"\nblock = 24')))[
        "loop_rate_Hz"
    ] == pytest.approx(4000 / 24)


@pytest.mark.parametrize(
    ("old", "new", "where", "slip"),
    [
        (
            "[1e-3, 1.2e-3, 0.0]",
            "[5000, 5000, 0]",
            "[device] damping_N_s_per_m",
            "a Q entered as damping? give q = 5000",
        ),
        ("mass_kg = 1e-3", "mass_kg = 0.1", "[device] mass_kg:", "grams for kilograms?"),
        ("amplitude_m = 1e-4", "amplitude_m = 1", "[device] amplitude_m", "µm for m?"),
        ("gain_V_per_m = -890", "gain_V_per_m = -890e-5", "[device.sense] gain_V_per_m", "V/µm for V/m"),
        ("full_scale = 10", "full_scale = 0.01", "[device.drive] full_scale", "N for m/s²?"),
        ("", "[observer]\nmemory_s = 100", "[observer] memory_s", "usual some hundred cycles"),
        ("", "[observer.initial_sd]\nrate_rad_s = 300", "[observer.initial_sd] rate_rad_s", "give rate_dps"),
        ("", "[limits]\nangle_rad = 5", "[limits] angle_rad", "give angle_deg"),
        ("", "[device.calibration]\nclock_u = 0.05", "[device.calibration] clock_u", "give clock_u_ppm"),
        (
            "",
            f"[controller]\ntarget_stiffness_N_per_m = {1e-3 * (201.0 * math.tau * math.tau) ** 2}",
            "[controller] target_stiffness_N_per_m",
            "Hz for rad/s?",
        ),
    ],
)
def test_a_slip_is_questioned_in_one_line(tmp_path: Path, old: str, new: str, where: str, slip: str) -> None:
    text = QUIET.replace(old, new) if old else f"{QUIET}\n{new}\n"
    asked = [one for one in questions(of(tmp_path, text)) if one.startswith(where)]
    assert len(asked) == 1, asked
    assert slip in asked[0]
    assert "usual" in asked[0] or "the drive has" in asked[0]
    assert "\n" not in asked[0]


def test_force_mode_on_a_clock_is_questioned_where_no_link_holds_it(tmp_path: Path) -> None:
    bench = load_bench(examples.find("bench", "s-modern"))
    assert not questions(bench)
    forced = bench.with_(loop={"mode": "force", "clock": "paced"})
    assert [one for one in questions(forced) if one.startswith('[loop] mode: "force" at 200 kS/s')]
    assert not [one for one in questions(bench.with_(loop={"mode": "force", "clock": "lockstep"})) if "mode" in one]


def runnable() -> list[str]:
    found = {name: load_any_bench(examples.find("bench", name)) for name in examples.names("bench")}
    return [name for name, bench in found.items() if isinstance(bench, Bench) and bench.controller.enabled]


@pytest.mark.parametrize("name", runnable())
def test_no_example_that_runs_is_questioned(name: str) -> None:
    assert questions(load_bench(examples.find("bench", name))) == []


@pytest.mark.moderate
def test_a_dry_run_prints_the_same_as_the_report_and_as_json(hil: Hil, tmp_path: Path) -> None:
    command = ("run", "s-slow", "--link", "inproc:s-slow", "--clock", "lockstep", "--dry-run")
    bench = load_bench(examples.find("bench", "s-slow"))
    code, out, err = hil(*command)
    assert code == 0, err
    code, text, _ = hil(*command, "--json")
    told = json.loads(text)
    lines = derived(bench, told["identity"])
    for line in lines:
        assert f"  {line.name:<18}{line.text}" in out
    assert told["derived"] == figures_of(lines)
    assert told["questions"] == []
    assert "11 600 codes" in out.replace("\u202f", " ")
    assert f"  spec_hash         {SPEC.hash:#010x}\n" in out
    assert "  capabilities      FORCE_MODE, GAIN_MODE, LOCKSTEP" in out


@pytest.mark.moderate
def test_a_dry_run_questions_what_is_improbable(hil: Hil, tmp_path: Path) -> None:
    (tmp_path / "slip.bench.toml").write_text(
        examples.find("bench", "s-slow").read_text().replace("[6.9e-4, 5.7e-4, 0.0]", "[1000, 1000, 0]"),
        encoding="utf-8",
    )
    code, out, err = hil("run", "slip.bench.toml", "--link", "inproc:s-slow", "--clock", "lockstep", "--dry-run")
    assert code == 0, err
    assert "question: [device] damping_N_s_per_m: Q is" in out
    assert "give q = 1000" in out


def test_init_echoes_it_too_and_alone_as_json(hil: Hil, tmp_path: Path) -> None:
    code, out, err = hil("init", *SHEET, "--out", "a.bench.toml", "--json")
    assert code == 0, err
    told = json.loads(out)
    assert told["derived"]["q"] == pytest.approx(5000)
    assert told["derived"]["split_Hz"] == pytest.approx(10)
    assert any('mode = "gain"' in one for one in told["questions"])  # 250 kS/s in force mode


@pytest.mark.moderate
def test_the_report_has_the_device_as_declared(tmp_path: Path) -> None:
    write_run(tmp_path / "20260101-000000-a", Options(seconds=2.0))
    bench = load_bench(examples.find("bench", "s-slow"))
    folder = RunFolder(tmp_path / "20260101-000000-a")
    folder.bench_path.write_text(template(values_of(bench), "As run."), encoding="utf-8")
    page = render(RunFolder(folder.path))
    for line in derived(bench):
        assert line.name in page
    assert "frequency split" in page
