"""Bench files in the units of the field: Hz, Q, decay time, split, degrees, °/s, ppm (docs/reference/bench.md)."""

import math
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from hil.bench import Bench, load_bench, override
from hil.bench.section import FIELD_UNITS, other_keys
from hil.bench.template import keys, missing, put_in, sections, template, values_of
from hil.toml.reading import parse_table
from tests.cli.conftest import Hil
from tests.cli.test_bench_file import MINIMAL, bench_file, complaint
from tests.cli.test_errors import refused

STIFFNESS = "stiffness_N_per_m = [1579.0, 1600.0, 10.0]"
DAMPING = "damping_N_s_per_m = [1e-3, 1.2e-3, 0.0]"
SINGLE = (
    MINIMAL.replace("mass_kg", "axes = 1\nmass_kg").replace(STIFFNESS, "stiffness_N_per_m = 1579").replace(
        DAMPING, "damping_N_s_per_m = 1e-3"
    )
    + "[controller]\nenabled = false\n"
)  # fmt: skip


def bench_of(folder: Path, text: str) -> Bench:
    return load_bench(bench_file(folder, text))


def resonant(*lines: str) -> str:
    return MINIMAL.replace(STIFFNESS, "\n".join(("resonance_Hz = 15000", *lines))).replace(
        "sample_rate_Hz = 4000", "sample_rate_Hz = 250000"
    )


@pytest.mark.parametrize("azimuth", [0.0, 30.0, 45.0, -60.0, 90.0])
@pytest.mark.parametrize("split", [0.0, 10.0, -10.0])
def test_a_resonance_and_its_split_are_the_matrix_with_those_eigenvalues(
    tmp_path: Path, azimuth: float, split: float
) -> None:
    bench = bench_of(tmp_path, resonant(f"split_Hz = {split}", f"azimuth_deg = {azimuth}"))
    xx, yy, xy = bench.device.stiffness_per_s2
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    assert np.sqrt(values) / (2 * np.pi) == pytest.approx(sorted([15000 - split / 2, 15000 + split / 2]), rel=1e-12)
    first = vectors[:, 1 if split > 0 else 0]
    along = [math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth))]
    if split:
        assert abs(first @ along) == pytest.approx(1.0, abs=1e-9)


def test_q_and_decay_time_are_one_damping(tmp_path: Path) -> None:
    """A free oscillator of that damping falls to 1/e in τ = Q/(π f) (textbooks): by the roots of m s² + d s + k."""
    for line in ("q = 5000", f"decay_time_s = {5000 / (math.pi * 15000)!r}"):
        device = bench_of(tmp_path, resonant().replace(DAMPING, line)).device
        (dxx, dyy, dxy), kxx = device.damping_per_s, device.stiffness_per_s2[0]
        root = np.roots([1.0, dxx, kxx])[0]
        assert (dyy, dxy) == (pytest.approx(dxx), pytest.approx(0.0, abs=1e-12))
        assert -1.0 / root.real == pytest.approx(5000 / (math.pi * 15000), rel=1e-9)
        assert abs(root) / (2 * -root.real) == pytest.approx(5000, rel=1e-9)


def test_two_quality_factors_stand_along_their_own_axes(tmp_path: Path) -> None:
    text = resonant().replace(DAMPING, "q = [4000, 6000]\ndamping_azimuth_deg = 30")
    xx, yy, xy = bench_of(tmp_path, text).device.damping_per_s
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    assert 2 * np.pi * 15000 / values == pytest.approx([6000, 4000])
    assert abs(vectors[:, 1] @ [math.cos(math.pi / 6), 0.5]) == pytest.approx(1.0, abs=1e-9)


def test_q_beside_a_stiffness_counts_at_its_resonance(tmp_path: Path) -> None:
    device = bench_of(tmp_path, MINIMAL.replace(DAMPING, "q = 1000")).device
    values = np.linalg.eigvalsh([[1.579e6, 1e4], [1e4, 1.6e6]])
    assert device.damping_per_s[0] == pytest.approx(float(np.sqrt(values).mean()) / 1000)


def test_a_single_axis_takes_them_too(tmp_path: Path) -> None:
    text = SINGLE.replace("stiffness_N_per_m = 1579", "resonance_Hz = 200").replace(
        "damping_N_s_per_m = 1e-3", "q = 100"
    )
    device = bench_of(tmp_path, text).device
    assert device.stiffness_per_s2 == (pytest.approx((400 * math.pi) ** 2),)
    assert device.damping_per_s == (pytest.approx(4 * math.pi),)


BESIDE = {"device.sense.interface": {"kind": "gap_closing", "gap_m": 1e-3}}
"""What a key of a table has a meaning with."""


def test_a_bench_file_takes_the_field_s_units(tmp_path: Path) -> None:
    """Each key of each table that has another unit, given in it, is the same bench."""
    found = [
        (path, key, other) for path, model in sections(Bench) for key, _ in keys(model) for other in other_keys(key)
    ]
    assert {
        "virtual_rotation_dps",
        "rate_dps",
        "angle_deg",
        "clock_u_ppm",
        "rate_dps_per_rts",
        "bias_deg_per_h",
        "angle_random_walk_deg_per_rth",
        "scale_factor_error_ppm",
    } <= {other.name for _, _, other in found}
    bench = bench_of(tmp_path, MINIMAL)
    for path, key, other in found:
        table = tomllib.loads(
            template(put_in(values_of(bench), {path: {**BESIDE.get(path, {}), other.name: 0.02}}), "Changed.")
        )
        here = parse_table(table, Bench, "changed")
        for part in path.split("."):
            here = getattr(here, part)
        assert np.ravel(getattr(here, key)) == pytest.approx(0.02 / other.per_model_unit, rel=1e-12), (path, key)


def test_a_degree_is_a_degree() -> None:
    factors = {unit.other: unit.per_model_unit for unit in FIELD_UNITS}
    assert math.pi * factors["_deg"] == pytest.approx(180.0)
    assert factors["_dps"] == factors["_deg"]
    assert factors["_u_ppm"] == 1e6
    assert factors["_deg_per_h"] == pytest.approx(math.degrees(1) * 3600)  # 1 rad/s is so many ° in an hour
    assert factors["_deg_per_rth"] == pytest.approx(math.degrees(1) * 3600**0.5)  # and 1 rad in √s so many in √h
    assert factors["_deg_per_h_per_rth"] == pytest.approx(math.degrees(1) * 3600 * 3600**0.5)
    assert factors["_deg_per_h2"] == pytest.approx(math.degrees(1) * 3600 * 3600)
    assert factors["_V_per_dps"] * factors["_dps"] == pytest.approx(1.0)  # 57.3 times volts per °/s is volts per rad/s


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            MINIMAL.replace(STIFFNESS, f"{STIFFNESS}\nresonance_Hz = 200"),
            "[device] stiffness_N_per_m, resonance_Hz: one quantity given in two ways; give one of them",
        ),
        (
            MINIMAL.replace(DAMPING, "q = 1000\ndecay_time_s = 1"),
            "[device] q, decay_time_s: one quantity given in two ways; give one of them",
        ),
        (
            MINIMAL + "[limits]\nangle_rad = 0.1\nangle_deg = 5",
            "[limits] angle_rad, angle_deg: one quantity in two units; give one of them",
        ),
        (MINIMAL + "[limits]\nangle_deg = '5'", "[limits] angle_deg: expected a number, not '5'"),
        (
            MINIMAL + "[limits]\nangle_deg = -5",
            "[limits] angle_deg: -5 (angle_rad = -0.0872665) should be greater than 0",
        ),
        (MINIMAL + "[limits]\nangle_degg = 5", "[limits] angle_degg: unknown key; did you mean angle_deg?"),
        (
            MINIMAL.replace(STIFFNESS, f"{STIFFNESS}\nsplit_Hz = 2"),
            "[device] split_Hz: stands beside resonance_Hz; give that too, or leave it out",
        ),
        (
            resonant("azimuth_deg = 20"),
            "[device] azimuth_deg: stands beside split_Hz; give that too, or leave it out",
        ),
        (
            resonant().replace(DAMPING, "q = 0"),
            "[device] q: 0 should be greater than 0; no damping is damping_N_s_per_m",
        ),
        (resonant().replace(DAMPING, "q = [1, 2, 3]"), "[device] q: expected one number or two, not 3"),
        (resonant("split_Hz = 40e3"), "[device] split_Hz: 40000 leaves no lower resonance below 15000 Hz"),
        (resonant().replace("15000", "-15000"), "[device] resonance_Hz: -15000 should be greater than 0"),
        (
            resonant().replace(DAMPING, ""),
            "[device] damping_N_s_per_m: missing; expected: [dxx, dyy, dxy] for two axes, "
            "[d] for one; or q, or decay_time_s",
        ),
        (
            SINGLE.replace("stiffness_N_per_m = 1579", "resonance_Hz = 200\nsplit_Hz = 1"),
            "[device] split_Hz: a single axis has none; leave it out",
        ),
    ],
)  # fmt: skip
def test_each_mistake_is_one_line_that_names_the_keys_given(tmp_path: Path, text: str, expected: str) -> None:
    assert complaint(tmp_path, text) == expected


def test_the_published_schema_takes_and_refuses_the_same(tmp_path: Path) -> None:
    schema = Bench.model_json_schema()
    for text, good in (
        (MINIMAL, True),
        (resonant("split_Hz = 10", "azimuth_deg = 3"), True),
        (resonant("azimuth_deg = 3"), False),
        (resonant().replace(DAMPING, "q = [4000, 6000]"), True),
        (MINIMAL + "[limits]\nangle_deg = 5", True),
        (MINIMAL + "[limits]\nangle_deg = 5\nangle_rad = 0.1", False),
        (MINIMAL.replace(STIFFNESS, f"{STIFFNESS}\nresonance_Hz = 200"), False),
        (MINIMAL.replace(DAMPING, "q = 1000\ndecay_time_s = 1"), False),
        (MINIMAL.replace(DAMPING, ""), False),
    ):
        assert jsonschema.Draft202012Validator(schema).is_valid(tomllib.loads(text)) == good, text


def test_a_bench_is_changed_in_either_unit(tmp_path: Path) -> None:
    bench = bench_of(tmp_path, MINIMAL)
    assert bench.with_(limits={"angle_deg": 5.0}).limits.angle_rad == pytest.approx(math.radians(5.0))
    retuned = bench.with_(device={"resonance_Hz": 180.0})
    assert retuned.device.resonance_Hz == pytest.approx(180.0)
    assert retuned.device.damping_N_s_per_m == bench.device.damping_N_s_per_m
    turned = override(bench, {"observer": {"initial": {"rate_dps": 90.0}}}, "options")
    assert turned.observer.initial.rate_rad_s == pytest.approx(math.pi / 2)


def test_a_run_keeps_its_bench_in_the_models_units(tmp_path: Path) -> None:
    bench = bench_of(tmp_path, resonant("split_Hz = 10").replace(DAMPING, "q = 5000"))
    kept = tomllib.loads(template(values_of(bench), "As run."))
    assert "resonance_Hz" not in kept["device"]
    assert parse_table(kept, Bench, "kept") == bench


SHEET = (
    "--name", "G", "--resonance", "15000", "--q", "5000", "--split", "10", "--mass", "1e-8", "--amplitude", "1e-6",
    "--sample-rate", "250000", "--sense-gain", "1e5", "--noise", "1e-4", "--full-scale", "20",
)  # fmt: skip


def test_init_writes_a_file_in_the_fields_units(hil: Hil, tmp_path: Path) -> None:
    code, out, err = hil("init", *SHEET, "--out", "mine.bench.toml")
    assert code == 0, err
    assert "Q 5000" in out
    assert "15.000 kHz" in out.replace("\u00a0", " ")
    written = tomllib.loads((tmp_path / "mine.bench.toml").read_text(encoding="utf-8"))["device"]
    assert (written["resonance_Hz"], written["split_Hz"], written["q"]) == (15000.0, 10.0, 5000.0)
    assert load_bench(tmp_path / "mine.bench.toml").device.mass_kg == 1e-8


def test_init_takes_the_place_of_what_another_file_says(hil: Hil, tmp_path: Path) -> None:
    code, _, err = hil("init", "--like", "s-slow", "--resonance", "210", "--split", "2", "--out", "mine.bench.toml")
    assert code == 0, err
    device = load_bench(tmp_path / "mine.bench.toml").device
    assert np.sqrt(np.array(device.stiffness_per_s2[:2])) / (2 * np.pi) == pytest.approx([211.0, 209.0])


def test_init_writes_nothing_that_hil_run_would_refuse(hil: Hil, tmp_path: Path) -> None:
    line = refused(hil("init", "--like", "s-slow", "--resonance", "3000", "--out", "mine.bench.toml"))
    assert "[device] sample_rate_Hz: 4000 gives fewer than 4 samples per cycle" in line
    assert not (tmp_path / "mine.bench.toml").exists()


def test_what_is_required_has_a_unit_and_an_example(tmp_path: Path) -> None:
    blank = template({}, "To be filled in.")
    lines = {line.split()[1]: line for line in blank.splitlines() if "REQUIRED" in line}
    assert set(lines) == {key.rpartition("] ")[2] for key in missing({})}
    for key, unit in (("mass_kg", "kg"), ("amplitude_m", "m"), ("damping_N_s_per_m", "N·s/m"), ("gain_V_per_m", "V/m")):
        assert f"REQUIRED, {unit}: " in lines[key]
    assert all("e.g. " in line for line in lines.values())
    filled = "\n".join(
        f"{line.split()[1]} = {line.rpartition('e.g. ')[2]}" if "REQUIRED" in line else line
        for line in blank.splitlines()
    )
    assert bench_of(tmp_path, filled)
