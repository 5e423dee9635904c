"""Scenario files: what is accepted, and that every mistake is one line with file, key and remedy."""

import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from device_emulator.scenario import load
from device_emulator.section import ScenarioError
from tests.emulator.gyro import EXAMPLES

SLOW = (EXAMPLES / "s-slow.scenario.toml").read_text()


@pytest.fixture
def complaint(tmp_path: Path) -> Callable[[str], str]:
    """The error of a scenario with this text, without the file's name, which must stand first."""

    def complain(text: str) -> str:
        path = tmp_path / "mine.scenario.toml"
        path.write_text(text)
        with pytest.raises(ScenarioError) as caught:
            load(path)
        message = str(caught.value)
        assert "\n" not in message
        assert message.startswith(f"{path}: ")
        return message.removeprefix(f"{path}: ")

    return complain


def changed(old: str, new: str) -> str:
    assert old in SLOW
    return SLOW.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("mass_kg", "mass_k", "[truth] mass_k: unknown key; did you mean mass_kg?"),
        ("mass_kg = 1e-3\n", "", "[truth] mass_kg: missing"),
        ("mass_kg = 1e-3", "mass_kg = '1e-3'", "[truth] mass_kg: expected a number, got '1e-3'"),
        ("mass_kg = 1e-3", "mass_kg = true", "[truth] mass_kg: expected a number, got True"),
        ("mass_kg = 1e-3", "mass_kg = inf", "[truth] mass_kg: expected a finite number, got inf"),
        ("mass_kg = 1e-3", "mass_kg = -1", "[truth] mass_kg: expected greater than 0, got -1"),
        ("1547.5540,", "-1547.0,", "[truth] stiffness_N_per_m 2: expected greater than 0, got -1547.0"),
        ("1547.5540, 15.7914]", "1547.5540]", "[truth] stiffness_N_per_m 3: missing"),
        (
            "15.7914]",
            "1e4]",
            "[truth]: stiffness_N_per_m: a matrix [xx, yy, xy] that could add energy; xy² must be at most xx yy",
        ),
        ("[1e-4, 0.0]", "1", "[truth] position_m: expected a list of numbers, got 1"),
        ("fingers = 100", "fingers = [1, 2, 3]", "[sense] fingers: expected 2 numbers, got 3"),
        ("fingers = 100", "fingers = [1, 0]", "[sense] fingers 2: expected greater than 0, got 0"),
        ("noise_V", "nois_V", "[sense] nois_V: unknown key; did you mean noise_V?"),
        ("adc_bits = 16", "adc_bits = 16.5", "[sense] adc_bits: expected a whole number, got 16.5"),
        ("adc_bits = 16", "adc_bits = 32", "[sense] adc_bits: expected less than or equal to 24, got 32"),
        ("dac_bits = 16", "dac_bits = 3", "[drive] dac_bits: expected greater than or equal to 4, got 3"),
        ("[board]", "[bord]", "bord: unknown key; did you mean board?"),
        ("seed = 1", "", "seed: missing"),
        (
            "seed",
            "noise",
            "noise: unknown key; known: seed, truth, sense, drive, board, rate, temperature, effect, trim, faults",
        ),
        ('"segments"', '"segment"', "[rate] kind: unknown kind 'segment'; did you mean segments?"),
        ('kind = "segments"', "", "[rate] kind: missing"),
        ("duration_s = 10.0\n", "", "[rate]: expected duration_s in every segment but the last"),
        ("duration_s", "durations", "[rate.segment 1] durations: unknown key; did you mean duration_s?"),
        ("rate_rad_s = 0.0\n", "", "[rate.segment 3] rate_rad_s: missing"),
        ("_Hz = 0.5", "_Hz = 0", "[rate.segment 4] frequency_Hz: expected greater than 0, got 0"),
        ("[truth]", "[truth", None),
    ],
)  # fmt: skip
def test_mistakes(complaint: Callable[[str], str], old: str, new: str, expected: str | None) -> None:
    message = complaint(changed(old, new))
    if expected is None:
        assert message.startswith("not a TOML file: ")
        assert "line " in message
    else:
        assert message == expected


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ('name = "cubic"', "effect 1: unknown effect 'cubic'; did you mean sense_cubic?"),
        ("k3x = 1.0", "effect 1: expected a table with a name and coefficients"),
        ('name = "cubic_stiffness"', "effect 1: cubic_stiffness needs k3x, k3y"),
        (
            'name = "cubic_stiffness"\nk3 = 1.0',
            "effect 1: cubic_stiffness has no coefficient 'k3'; did you mean k3y?",
        ),
        (
            'name = "cubic_stiffness"\nk3x = "big"',
            "effect 1: expected a finite number for k3x, got 'big'",
        ),
        ('name = "cubic_stiffness"\nk3x = nan', "effect 1: expected a finite number for k3x, got nan"),
        ('name = "dry_friction"\nfx = 1.0', "effect 1: dry_friction needs v0"),
        ('name = "sense_delay"\ntsx = 1.0', "effect sense_delay: expected 0 to 30 samples"),
        ('name = "drive_delay"\ntuy = -1e-6', "effect drive_delay: expected 0 to 30 samples"),
    ],
)
def test_mistakes_in_effects(complaint: Callable[[str], str], effect: str, expected: str) -> None:
    assert complaint(f"{SLOW}\n[[effect]]\n{effect}\n") == expected


@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        ('kind = "steps"\ntimes_s = [1.0]\nrates_rad_s = [1.0]', "[rate]: expected times_s to begin at 0"),
        (
            'kind = "steps"\ntimes_s = [0.0, 0.0]\nrates_rad_s = [1.0, 2.0]',
            "[rate]: expected times_s to increase",
        ),
        (
            'kind = "steps"\ntimes_s = [0.0]\nrates_rad_s = [1.0, 2.0]',
            "[rate]: expected as many rates_rad_s as times_s",
        ),
        ('kind = "constant"\nrate_rad = 1.0', "[rate] rate_rad: unknown key; did you mean rate_rad_s?"),
    ],
)
def test_mistakes_in_the_rate(complaint: Callable[[str], str], rate: str, expected: str) -> None:
    assert complaint(f"{SLOW[: SLOW.index('[rate]')]}[rate]\n{rate}\n") == expected


def test_a_rate_that_is_no_table(complaint: Callable[[str], str]) -> None:
    assert complaint(f"rate = 1\n{SLOW[: SLOW.index('[rate]')]}") == "[rate]: expected a table, got 1"


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"none.toml: cannot read the scenario \(No such file or directory\)$"):
        load(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\x00")
    with pytest.raises(ScenarioError, match=r"binary.toml: not a TOML file: "):
        load(tmp_path / "binary.toml")


def test_one_number_stands_for_both_axes_and_infinity_for_no_filter(tmp_path: Path) -> None:
    path = tmp_path / "both.toml"
    path.write_text(changed("fingers = 100", "fingers = 100\nfeedback_ohm = [inf, 1e9]\nlow_pass_Hz = 1e4"))
    sense = load(path).sense
    assert sense.fingers == (100.0, 100.0)
    assert sense.feedback_ohm == (math.inf, 1e9)
    assert sense.low_pass_Hz == (1e4, 1e4)


def test_a_rate_file_lies_beside_its_scenario(tmp_path: Path) -> None:
    path = tmp_path / "filed.toml"
    path.write_text(f'{SLOW[: SLOW.index("[rate]")]}[rate]\nkind = "file"\npath = "turn.csv"\n')
    rate = load(path).rate
    assert rate.kind == "file"
    assert Path(rate.path) == tmp_path / "turn.csv"


def test_the_undeclared_example_differs_by_its_effect_alone() -> None:
    slow = tomllib.loads(SLOW)
    undeclared = tomllib.loads((EXAMPLES / "s-undeclared.scenario.toml").read_text())
    assert undeclared.pop("effect")[0]["name"] == "cubic_stiffness"
    assert undeclared["board"].pop("unique_id") != slow["board"].pop("unique_id")
    assert undeclared == slow
