"""Scenario files in the units of the field, and their page of the reference (docs/reference/scenario.md)."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from device_emulator.rate import pieces
from device_emulator.scenario import Scenario, load
from device_emulator.section import ScenarioError

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "scenario.md").read_text(encoding="utf-8")
EXAMPLE = PAGE.split("```toml\n")[1].split("```")[0]
IN_MATRICES = EXAMPLE.replace("resonance_Hz = 200.0\nsplit_Hz = 4.0\nazimuth_deg = 15.0\nq = 1000.0\n", "{}\n")


def scenario(folder: Path, text: str) -> Scenario:
    path = folder / "board.scenario.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)


def test_the_page_has_every_table_and_key() -> None:
    for name, field in Scenario.model_fields.items():
        assert f"[{name}]" in PAGE or f"`{name}`" in PAGE, name
        if hasattr(field.annotation, "model_fields"):
            assert all(f"`{key}`" in PAGE for key in field.annotation.model_fields)


def test_the_example_of_the_page_is_a_board(tmp_path: Path) -> None:
    truth = scenario(tmp_path, EXAMPLE).truth
    xx, yy, xy = truth.stiffness_N_per_m
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]) / 1e-3)
    assert np.sqrt(values) / (2 * np.pi) == pytest.approx([198.0, 202.0])
    assert abs(vectors[:, 1] @ [math.cos(math.radians(15)), math.sin(math.radians(15))]) == pytest.approx(1.0)
    assert truth.damping_N_s_per_m == pytest.approx((1e-3 * 400 * math.pi / 1000, 1e-3 * 400 * math.pi / 1000, 0.0))


def test_decay_times_along_their_axes(tmp_path: Path) -> None:
    given = EXAMPLE.replace("q = 1000.0", "decay_time_s = [2.0, 4.0]\ndamping_azimuth_deg = 90")
    damping = scenario(tmp_path, given).truth.damping_N_s_per_m
    assert np.array(damping) / 1e-3 == pytest.approx([0.5, 1.0, 0.0], abs=1e-12)  # 2/τ, the first along y


@pytest.mark.parametrize(
    ("degrees", "radians"),
    [
        ('kind = "constant"\nrate_dps = 90', 'kind = "constant"\nrate_rad_s = 1.5707963267948966'),
        (
            'kind = "steps"\ntimes_s = [0, 1]\nrates_dps = [90, -45]',
            'kind = "steps"\ntimes_s = [0, 1]\nrates_rad_s = [1.5707963267948966, -0.7853981633974483]',
        ),
        (
            'kind = "sine"\namplitude_dps = 180\nfrequency_Hz = 2\nphase_deg = 90\noffset_dps = 45',
            'kind = "sine"\namplitude_rad_s = 3.141592653589793\nfrequency_Hz = 2\nphase_rad = 1.5707963267948966\n'
            "offset_rad_s = 0.7853981633974483",
        ),
        (
            'kind = "ramp"\nfrom_dps = 0\nto_dps = 180\nduration_s = 2',
            'kind = "ramp"\nfrom_rad_s = 0\nto_rad_s = 3.141592653589793\nduration_s = 2',
        ),
        (
            'kind = "segments"\n[[rate.segment]]\nkind = "constant"\nrate_dps = 90',
            'kind = "segments"\n[[rate.segment]]\nkind = "constant"\nrate_rad_s = 1.5707963267948966',
        ),
    ],
)
def test_a_profile_in_degrees_is_the_same_profile(tmp_path: Path, degrees: str, radians: str) -> None:
    before = EXAMPLE.partition("[rate]")[0]
    given, wanted = (scenario(tmp_path, f"{before}[rate]\n{text}\n").rate for text in (degrees, radians))
    assert given == wanted


def test_a_rate_file_in_degrees(tmp_path: Path) -> None:
    (tmp_path / "turn.csv").write_text("t_s, rate_dps\n0, 0\n1, 180\n", encoding="utf-8")
    given = scenario(
        tmp_path, EXAMPLE.replace('kind = "constant"\nrate_dps = 90.0', 'kind = "file"\npath = "turn.csv"')
    )
    assert pieces(given.rate)["rate_rad_s"][-1] == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "rate_dps = 90.0",
            "rate_dps = 90.0\nrate_rad_s = 1",
            "rate_rad_s, rate_dps: one quantity in two units; give one",
        ),
        (
            "q = 1000.0",
            "q = 1000.0\ndecay_time_s = 1",
            "q, decay_time_s: one quantity given in two ways; give one of them",
        ),
        ("resonance_Hz = 200.0\n", "", "split_Hz: stands beside resonance_Hz; give that too, or leave it out"),
        ("q = 1000.0", "q = 0", "q: expected one or two numbers greater than 0"),
        ("q = 1000.0", "q = '1'", "q: expected a number, got '1'"),
        ("q = 1000.0", "qq = 1000", "[truth] qq: unknown key; did you mean q?"),
        ("rate_dps = 90.0", "rate_dsp = 90.0", "rate_dsp: unknown key; did you mean rate_dps?"),
        ("rate_dps = 90.0", "rate_dps = 'fast'", "expected a number, got 'fast'"),
    ],
)
def test_each_mistake_is_one_line_that_names_the_keys(tmp_path: Path, old: str, new: str, told: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario(tmp_path, EXAMPLE.replace(old, new))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_matrices_are_taken_as_before(tmp_path: Path) -> None:
    given = IN_MATRICES.format("stiffness_N_per_m = [1610.0, 1547.0, 15.0]\ndamping_N_s_per_m = [1e-3, 1e-3, 0.0]")
    assert scenario(tmp_path, given).truth.stiffness_N_per_m == (1610.0, 1547.0, 15.0)
    assert tomllib.loads(given)["truth"]["stiffness_N_per_m"] == [1610.0, 1547.0, 15.0]
