"""The bench file: what it accepts, and that every mistake is one line naming file, key and remedy."""

import tomllib
from pathlib import Path

import pytest

from hil.bench import Bench, examples, load_bench, override
from hil.bench.template import missing, template, values_of
from hil.errors import InputError
from hil.toml.reading import parse_table

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"

MINIMAL = """
[device]
name = "probe"
mass_kg = 1e-3
stiffness_N_per_m = [1579.0, 1600.0, 10.0]
damping_N_s_per_m = [1e-3, 1.2e-3, 0.0]
amplitude_m = 1e-4
sample_rate_Hz = 4000
[device.sense]
gain_V_per_m = -890
noise_V = 1e-4
[device.drive]
full_scale = 10
"""


def bench_file(folder: Path, text: str) -> Path:
    path = folder / "probe.bench.toml"
    path.write_text(text, encoding="utf-8")
    return path


def complaint(folder: Path, text: str) -> str:
    """The one-line error of a file, without the file's name."""
    path = bench_file(folder, text)
    with pytest.raises(InputError) as caught:
        load_bench(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def test_minimal_file_has_sensible_defaults(tmp_path: Path) -> None:
    bench = load_bench(bench_file(tmp_path, MINIMAL))
    assert bench.device.axes == 2
    assert bench.loop.clock == "paced"
    assert bench.observer.variant == "full"
    assert bench.device.sense_gains_V_per_m == (-890.0, -890.0)


def test_quantities_per_unit_mass(tmp_path: Path) -> None:
    bench = load_bench(bench_file(tmp_path, MINIMAL))
    assert bench.device.stiffness_per_s2 == pytest.approx((1.579e6, 1.6e6, 1e4))
    assert bench.device.damping_per_s == pytest.approx((1.0, 1.2, 0.0))
    assert bench.target_stiffness_per_s2 == pytest.approx(1.5895e6)
    assert bench.device.resonance_Hz == pytest.approx(201.317, abs=1e-3)


def test_given_target_stiffness_wins(tmp_path: Path) -> None:
    bench = load_bench(bench_file(tmp_path, MINIMAL + "[controller]\ntarget_stiffness_N_per_m = 1500\n"))
    assert bench.target_stiffness_per_s2 == pytest.approx(1.5e6)


@pytest.mark.parametrize(
    ("unit", "more", "expected"),
    [("mps2", "", 1.0), ("N", "", 1000.0), ("V", "gain_N_per_V = 0.02", 20.0)],
)
def test_drive_per_unit(tmp_path: Path, unit: str, more: str, expected: float) -> None:
    text = MINIMAL.replace("full_scale = 10", f'full_scale = 10\nunit = "{unit}"\n{more}')
    device = load_bench(bench_file(tmp_path, text)).device
    assert device.drive_mps2_per(device.drive.unit) == pytest.approx(expected)


def test_offset_deviation_comes_from_the_data_sheet_unless_overridden(tmp_path: Path) -> None:
    sheet = MINIMAL.replace("noise_V = 1e-4", "noise_V = 1e-4\noffset_sd_V = 0.01")
    assert load_bench(bench_file(tmp_path, sheet)).offset_sd_V == 0.01
    assert load_bench(bench_file(tmp_path, sheet + "[observer.initial_sd]\noffset_V = 0.02")).offset_sd_V == 0.02


@pytest.mark.parametrize(
    ("added", "expected"),
    [
        ("[observer]\nmemmory_s = 1", "[observer] memmory_s: unknown key; did you mean memory_s?"),
        ("[observer]\nmemory_ms = 1", "[observer] memory_ms: unknown key; did you mean memory_s?"),
        ("[obsever]\nmemory_s = 1", "[obsever]: unknown section; did you mean observer?"),
        ("[observer.inital]\nrate_rad_s = 1", "[observer] inital: unknown section; did you mean initial?"),
        ("[observer]\nmemory_s = '1'", "[observer] memory_s: expected a number, not '1'"),
        ("[observer]\nmemory_s = 0", "[observer] memory_s: 0 should be greater than 0"),
        ("[observer]\nmemory_s = nan", "[observer] memory_s: expected a finite number, not nan"),
        (
            "[observer]\nvariant = 'ful'",
            "[observer] variant: 'ful' is not one of full, gyro, sense; did you mean full?",
        ),
        ("[loop]\nseed = 1.5", "[loop] seed: expected a whole number, not 1.5"),
        (
            "[loop]\nname = 'a/b'",
            "[loop] name: 'a/b' is no name of a run; take letters, digits, '.', '-', '_', a letter or digit first",
        ),
        (
            "[loop]\nsettle_s = 30",
            "[loop] settle_s: 30 s leaves nothing to score of duration_s = 30 s; run for longer, or lower it "
            "in a bench file of your own (hil init --like)",
        ),
        ("[controller]\nenabled = 1", "[controller] enabled: expected true or false, not 1"),
        ("[link]\nwatchdog_s = 1e-4", "[link] watchdog_s: shorter than two samples (0.0005 s)"),
        (
            "[observer.initial]\noffset_V = [1, 2, 3]",
            "[observer.initial] offset_V: expected 2 numbers, one per axis, not 3",
        ),
        (
            "[observer.initial]\noffset_V = [1, 'a']",
            "[observer.initial] offset_V[1]: expected a number, not 'a'",
        ),
        (
            "[observer.initial]\ndamping_N_s_per_m = [1]",
            "[observer.initial] damping_N_s_per_m: axes = 2 needs [dxx, dyy, dxy], not 1 of them",
        ),
        (
            "[controller]\namplitude_modulation = 0.01\nmodulation_Hz = 50",
            "[controller] modulation_Hz: must stay below a tenth of 201.3 Hz",
        ),
    ],
)
def test_mistakes_in_optional_sections(tmp_path: Path, added: str, expected: str) -> None:
    assert complaint(tmp_path, MINIMAL + added) == expected


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("mass_kg = 1e-3", "", "[device] mass_kg: missing; expected: proof mass"),
        (
            "amplitude_m",
            "amplitude_mm",
            "[device] amplitude_mm: unknown key; did you mean amplitude_m? (and 1 more)",
        ),
        (
            "[1579.0, 1600.0, 10.0]",
            "1579",
            "[device] stiffness_N_per_m: axes = 2 needs [kxx, kyy, kxy], not 1 of them",
        ),
        (
            "[1579.0, 1600.0, 10.0]",
            "[1579, -1, 0]",
            "[device] stiffness_N_per_m: the diagonal must be positive, or nothing oscillates",
        ),
        ("= 4000", "= 400", "[device] sample_rate_Hz: 400 gives fewer than 4 samples per cycle of 201.3 Hz"),
        ("-890", "0", "[device.sense] gain_V_per_m: expected one number or 2, none of them 0"),
        ('name = "probe"', 'name = "probe"\naxes = 3', "[device] axes: 3 is not one of 1, 2"),
        (
            "full_scale = 10",
            'full_scale = 10\nunit = "V"',
            '[device.drive] gain_N_per_V: belongs to unit = "V" and only there; give the force per volt',
        ),
        (
            "full_scale = 10",
            "full_scale = 10\ngain_known = false",
            "[device.drive] gain_known: a drive gain is estimated for axes = 1 only; set it to true",
        ),
    ],
)
def test_mistakes_in_the_device(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in MINIMAL
    assert complaint(tmp_path, MINIMAL.replace(old, new)) == expected


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        ("", "[controller] enabled: a single axis has no pattern to control; set enabled = false"),
        (
            '[controller]\nenabled = false\n[observer]\nvariant = "gyro"',
            '[observer] variant: "gyro" needs axes = 2; a single axis runs "full" or "sense"',
        ),
    ],
)
def test_mistakes_with_a_single_axis(tmp_path: Path, section: str, expected: str) -> None:
    single = (
        MINIMAL.replace('name = "probe"', 'name = "probe"\naxes = 1')
        .replace("[1579.0, 1600.0, 10.0]", "1579")
        .replace("[1e-3, 1.2e-3, 0.0]", "1e-3")
    )
    assert complaint(tmp_path, single + section) == expected


def test_files_that_are_no_toml(tmp_path: Path) -> None:
    assert complaint(tmp_path, "[device\n") == (
        "not TOML: Expected ']' at the end of a table declaration (at line 1, column 8)"
    )
    path = bench_file(tmp_path, "")
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(InputError, match="byte 8 is not UTF-8"):
        load_bench(path)
    with pytest.raises(InputError, match=r"absent\.toml: no such file"):
        load_bench(tmp_path / "absent.toml")
    with pytest.raises(InputError, match="is a directory"):
        load_bench(tmp_path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[observer]\nq = 1\n[observer]\n", "[observer] is declared twice (at line 3); put its keys into one"),
        ("[a]\n[[b]]\n\n[a]\n", "[a] is declared twice (at line 4); put its keys into one"),
        ("[device.'the sense']\n" * 2, '[device."the sense"] is declared twice (at line 2); put its keys into one'),
        ("[a]\nq = 1\nq = 1\n", "a key or a table is declared twice (at line 3); take one out"),
        ("[a]\nq = 1\nq = 1", "a key or a table is declared twice (at end of document); take one out"),
    ],
)
def test_what_is_there_twice_is_named_with_its_line(tmp_path: Path, text: str, expected: str) -> None:
    assert complaint(tmp_path, text) == f"not TOML: {expected}"


def test_overrides_are_checked_like_the_file(tmp_path: Path) -> None:
    bench = load_bench(bench_file(tmp_path, MINIMAL))
    longer = override(bench, {"loop": {"duration_s": 60.0, "clock": "lockstep"}}, "options")
    assert (longer.loop.duration_s, longer.loop.clock) == (60.0, "lockstep")
    assert longer.device == bench.device
    with pytest.raises(InputError, match=r"^options: \[loop\] settle_s: 5 s leaves nothing"):
        override(bench, {"loop": {"duration_s": 2.0}}, "options")


@pytest.mark.parametrize("name", [name for name in examples.names("bench") if not name.startswith("rate-table")])
def test_examples_are_valid_and_survive_writing(name: str) -> None:
    bench = load_bench(examples.find("bench", name))
    assert parse_table(tomllib.loads(template(values_of(bench), "As run.")), Bench, name) == bench


def test_written_text_is_escaped(tmp_path: Path) -> None:
    bench = load_bench(bench_file(tmp_path, MINIMAL))
    odd = override(bench, {"device": {"name": 'a "b"\\ \n\x7f é'}}, "options")
    assert tomllib.loads(template(values_of(odd), "As run."))["device"]["name"] == 'a "b"\\ \n\x7f é'


def test_template_says_what_is_still_to_be_filled_in(tmp_path: Path) -> None:
    known = {"device": {"axes": 2, "sample_rate_Hz": 4000.0}, "device.drive": {"full_scale": 10.0}}
    assert missing(known) == [
        "[device] name",
        "[device] mass_kg",
        "[device] stiffness_N_per_m",
        "[device] damping_N_s_per_m",
        "[device] amplitude_m",
        "[device.sense] gain_V_per_m",
        "[device.sense] noise_V",
    ]
    assert complaint(tmp_path, template(known, "Board 1.")).startswith("[device] name: missing")
    filled = template(known, "Board 1.").replace("# name =", 'name = "b" #')
    assert complaint(tmp_path, filled).startswith("[device] mass_kg: missing")


def test_examples_are_found_by_name_path_and_neighbour(tmp_path: Path) -> None:
    own = bench_file(tmp_path, MINIMAL)
    assert examples.find("bench", str(own)) == own
    assert examples.find("bench", "probe.bench.toml", beside=own) == own
    assert examples.find("bench", "s-slow").name == "s-slow.bench.toml"
    with pytest.raises(InputError, match=r"s-slwo: no such bench file.*did you mean s-slow\?"):
        examples.find("bench", "s-slwo")


def test_a_modulation_that_the_file_does_not_ask_for_refuses_no_device(tmp_path: Path) -> None:
    """At 6.4 Hz the default frequency of the modulation is too fast; the file has no modulation."""
    slow = MINIMAL.replace("mass_kg = 1e-3", "mass_kg = 1.0")
    assert load_bench(bench_file(tmp_path, slow)).device.resonance_Hz == pytest.approx(6.366, abs=1e-3)
    told = complaint(tmp_path, f"{slow}[controller]\namplitude_modulation = 0.01\n")
    assert told.startswith(
        "[controller] amplitude_modulation: modulation_Hz is 1 Hz, and must stay below a tenth of 6.366"
    )
