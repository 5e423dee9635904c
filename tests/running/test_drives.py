"""What a start would drive a board with: every value, with its unit, and what a setting changed."""

import pytest

import hil
from hil.bench import Bench
from hil.running.process.live_settings import Settings, with_settings
from hil.running.safety.drives import digest, drives, in_one_line

LINK = "serial:/dev/ttyACM0"


@pytest.fixture(scope="module")
def bench() -> Bench:
    return hil.load_bench("s-slow")


@pytest.mark.parametrize(
    ("setting", "value", "name", "told"),
    [
        ("amplitude", 123e-6, "amplitude", "123 µm"),
        ("virtual_rotation", -1.25, "virtual rotation", "-1.25 rad/s"),
        ("dither", 0.07, "dither", "0.07 m/s² rms"),
        ("target_stiffness", 1.7, "target stiffness", "1.7 N/m"),
    ],
)
def test_every_setting_is_told_beside_what_the_bench_file_says(
    bench: Bench, setting: str, value: float, name: str, told: str
) -> None:
    assert setting in Settings.model_fields
    changed = dict(drives(with_settings(bench, {setting: value}), LINK, bench))
    declared = dict(drives(bench, LINK))
    assert changed.pop(name) == f"{told} (a setting; the bench file says {declared.pop(name)})"
    assert changed == declared


def test_there_is_a_line_for_every_setting(bench: Bench) -> None:
    assert len(Settings.model_fields) == 4  # a fifth one needs a row in the test above, and a line of its own


@pytest.mark.parametrize(
    ("drive", "most"),
    [
        ({"unit": "mps2", "full_scale": 4.0}, "4 m/s²"),
        ({"unit": "N", "full_scale": 4e-6}, "of a full scale of 4e-06 N"),
        ({"unit": "V", "full_scale": 2.0, "gain_N_per_V": 1e-6}, "of a full scale of 2 V"),
    ],
)
def test_the_largest_drive_is_told_in_one_unit(bench: Bench, drive: dict[str, object], most: str) -> None:
    controller = {"dither_mps2": 0.0}
    other = bench.with_(device={"drive": drive}, controller=controller)
    told = dict(drives(other, LINK))["largest drive"]
    scale = {"mps2": 1.0, "N": 1.0 / bench.device.mass_kg, "V": 1e-6 / bench.device.mass_kg}[str(drive["unit"])]
    assert told.startswith(f"{float(str(drive['full_scale'])) * scale:.6g} m/s²")
    assert told.endswith(most)


def test_a_digest_is_of_what_is_shown(bench: Bench) -> None:
    facts = drives(bench, LINK)
    assert digest(facts) == digest(drives(bench, LINK))
    others = [
        drives(bench, "serial:/dev/ttyACM1"),
        drives(with_settings(bench, {"amplitude": 101e-6}), LINK),
        drives(bench.with_(limits={"residual_safe": 7.0}), LINK),
        drives(bench.with_(controller={"enabled": False}), LINK),
    ]
    assert len({digest(one) for one in (facts, *others)}) == 5
    assert "\n" not in in_one_line(facts)
