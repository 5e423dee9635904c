"""`hil generate`: what it writes computes what the bench computes, and is clean C."""

import ctypes
import errno
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hil
from estimator.observer import Observer
from hil.bench import load_bench, override
from hil.errors import InputError
from hil.generating.c_code import MISSING, golden, sizes
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.library.generating import assumed_board
from tests.forked import hil_says
from tests.running.test_interfaces import BOARDS

pytestmark = pytest.mark.usefixtures("no_sizes")

EXAMPLES = Path(__file__).parents[2] / "examples"
STRICT = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wdouble-promotion"]
SANITIZED = ["-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]  # at -O2 GCC takes 8 s

BENCHES: dict[str, dict[str, dict[str, Any]]] = {
    "full": {},
    "EKF": {"observer": {"gain": "ekf"}},
    "sense": {"observer": {"variant": "sense"}},
    "gyro": {"observer": {"variant": "gyro"}},
    "stationary": {"observer": {"gain": "stationary", "memory_s": 0.1}},
    "effects": {"effects": {"cubic_stiffness": {}, "drive_gain": {}}},
    "late drive": {"effects": {"drive_delay": {}}},
    "late sense": {"effects": {"sense_delay": {}}},
    "line": {"effects": {"interference": {"omega": 314.0}}},
    "low pass": {"effects": {"sense_low_pass": {}}},
    "high pass": {"effects": {"sense_high_pass": {"leak_x": 5.0, "leak_y": 7.0}}},
    "second mode": {"effects": {"parasitic_mode": {"omega": 5000.0, "zeta": 0.01}}},
    "friction": {"effects": {"dry_friction": {}}},
    "own law": {"effects": {"custom": {"wall": {
        "force_x": "-p * x * (1 + tanh((abs(x) - gap) / width))",
        "force_y": "-q * y * r**2",
        "coefficients": {"p": {"unit": "1/s²", "start": 1.0}, "q": {"unit": "1/(m²·s²)", "start": 1e10}},
        "parameters": {"gap": {"unit": "m", "value": 1e-4}, "width": {"unit": "m", "value": 1e-5}},
    }}}},
}  # fmt: skip
BENCHES |= {
    kind: {"device": {"sense": {**sense, "interface": {"kind": kind, **keys}}}}
    for kind, (_, sense, keys) in BOARDS.items()
    if kind not in ("comb", "piezoresistive")
}


def compiled(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the golden test, compiled with every warning as an error."""
    program = folder / "test"
    sources = [folder / "test_golden.c", folder / "gyro_estimator.c"]
    subprocess.run(["cc", *STRICT, *options, "-o", program, *sources, "-lm"], check=True)
    return subprocess.run([program], capture_output=True, text=True, check=False)


def golden_cases() -> Iterator[Any]:
    """All in double; in 32 bits that of most states, of effects and of a stationary gain: the rest is long."""
    for float32, suffix in ((False, "double"), (True, "float32")):
        for name in BENCHES:
            marks = [pytest.mark.long] if float32 and name not in ("full", "effects", "stationary") else []
            yield pytest.param(name, float32, id=f"{name}-{suffix}", marks=marks)


@pytest.mark.parametrize(("name", "float32"), list(golden_cases()))
@pytest.mark.slow
def test_the_golden_test_passes_optimised_and_under_sanitizers(name: str, float32: bool, tmp_path: Path) -> None:
    bench = override(load_bench(EXAMPLES / "s-slow.bench.toml"), BENCHES[name], "test")
    hil.generate(bench, out=tmp_path, float32=float32)
    for options in ([], SANITIZED):
        done = compiled(tmp_path, *options)
        assert (done.returncode, done.stderr) == (0, ""), done.stdout
        if not float32:
            assert "drive codes that differ: 0," in done.stdout


MUTANTS = {
    "sign": ("drive_codes[i] = (int32_t)codes[i];", "drive_codes[i] = -(int32_t)codes[i];"),
    "quantiser": ("RINT(value / settings->quantum)", "FLOOR(value / settings->quantum)"),
    "lower limit": ("within(value, -settings->force_limit, settings->force_limit)",
                    "within(value, R(-0.5) * settings->force_limit, R(0.5) * settings->force_limit)"),
    "no limit": ("within(value, -settings->force_limit, settings->force_limit)", "value"),
}  # fmt: skip


@pytest.mark.parametrize("float32", [False, True])
@pytest.mark.slow
def test_the_golden_test_fails_where_the_drive_codes_are_wrong(float32: bool, tmp_path: Path) -> None:
    hil.generate("s-slow", out=tmp_path, float32=float32)
    source = tmp_path / "gyro_estimator.c"
    right = source.read_text()
    assert compiled(tmp_path, "-O0").stdout.endswith("PASS\n")
    for name, (text, instead) in MUTANTS.items():
        assert right.count(text) == 1, name
        rounds = "floorf" if float32 else "floor"
        source.write_text(right.replace(text, instead.replace("FLOOR", rounds)))
        done = compiled(tmp_path, "-O0")
        assert done.stdout.endswith("FAIL\n"), (name, done.stdout)
        assert done.returncode == 1, name


def loaded(folder: Path) -> tuple[ctypes.CDLL, Any]:
    """What was generated as a library, and an estimator of it."""
    library = folder / "library.so"
    subprocess.run(["cc", *STRICT, "-shared", "-fPIC", "-o", library, folder / "gyro_estimator.c", "-lm"], check=True)
    theirs = ctypes.CDLL(str(library))
    theirs.gyro_estimator_size.restype = ctypes.c_size_t
    estimator = ctypes.create_string_buffer(theirs.gyro_estimator_size())
    theirs.gyro_estimator_init(estimator)
    return theirs, estimator


@pytest.mark.slow
def test_a_missing_drive_is_the_one_that_was_asked_for_and_poisons_nothing(tmp_path: Path) -> None:
    """In codes and in SI: the same answers as with the drive that acted."""
    hil.generate("s-slow", out=tmp_path)
    bench = load_bench(EXAMPLES / "s-slow.bench.toml")
    identity = assumed_board(bench, 1, None, None)
    device = board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity)
    vectors = golden(Observer(*device), 600, 200)
    codes, reals = ctypes.c_int32 * 2, ctypes.c_double * 2
    drive, forces, angle = codes(), reals(), ctypes.c_double()
    theirs, in_codes = loaded(tmp_path)
    in_si = ctypes.create_string_buffer(theirs.gyro_estimator_size())
    theirs.gyro_estimator_init(in_si)
    for m in range(len(vectors.angle)):
        on, gone = int(m >= vectors.quiet), m % 50 == 7
        sense = codes(*map(int, vectors.sense[m]))
        applied = [MISSING, MISSING] if gone else [int(code) for code in vectors.applied[m]]
        theirs.estimator_step_codes(in_codes, sense, codes(*applied), on, drive)
        assert tuple(drive) == tuple(vectors.drive[m])
        volts = reals(*(np.nan if code == MISSING else code * identity.sense_scale_V for code in sense))
        acted = reals(np.inf, np.nan) if gone else reals(*(code * identity.drive_scale_mps2 for code in applied))
        theirs.estimator_step(in_si, volts, acted, on, forces, ctypes.byref(angle))
        assert abs(angle.value - vectors.angle[m]) < 1e-9


@pytest.mark.slow
def test_what_the_caller_has_to_know_is_in_the_header_and_the_readme(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.generating.c_code.sizes", sizes)
    bench = override(load_bench(EXAMPLES / "s-slow.bench.toml"), {"observer": {"acquisition_s": 0.0301}}, "test")
    made = hil.generate(bench, out=tmp_path)
    header = (tmp_path / "gyro_estimator.h").read_text()
    assert "#define GYRO_ACQUISITION_SAMPLES 121 " in header
    assert "#define GYRO_MISSING INT32_MIN " in header
    if made.sizes is None:
        pytest.skip("arm-none-eabi-gcc is missing")
    assert 500 < (made.sizes.stack_bytes or 0) < made.sizes.flash_bytes
    assert f"{made.sizes.stack_bytes} of stack" in (tmp_path / "README.txt").read_text()
    assert "fpv5-d16" in (tmp_path / "README.txt").read_text()


@pytest.mark.slow
def test_double_is_the_bench_to_the_last_bit(tmp_path: Path) -> None:
    bench = load_bench(EXAMPLES / "s-slow.bench.toml")
    hil.generate(bench, out=tmp_path)
    theirs, estimator = loaded(tmp_path)
    observer = Observer(
        board_device_of(bench),
        observer_settings_of(bench),
        controller_settings_of(bench, assumed_board(bench, 1, None, None)),
    )
    vectors = golden(observer, 3000, 300)
    two = ctypes.c_int32 * 2
    drive = two()
    assert (vectors.sense == MISSING).any(axis=0).all()
    for m in range(len(vectors.angle)):
        sense, applied = (two(*map(int, rows[m])) for rows in (vectors.sense, vectors.applied))
        theirs.estimator_step_codes(estimator, sense, applied, int(m >= vectors.quiet), drive)
        assert tuple(drive) == tuple(vectors.drive[m])
    estimate = (ctypes.c_double * 35)()  # gyro_estimate: 34 numbers, and whether they are valid
    theirs.gyro_estimator_read(estimator, estimate)
    assert np.array_equal(estimate[:13], vectors.state)
    assert np.array_equal(estimate[13:26], vectors.deviation)
    assert estimate[30] == vectors.angle[-1]


def test_only_the_effects_declared_are_written(tmp_path: Path) -> None:
    bench = load_bench(EXAMPLES / "s-slow.bench.toml")
    hil.generate(bench, out=tmp_path / "plain")
    hil.generate(override(bench, {"effects": {"cubic_stiffness": {}}}, "test"), out=tmp_path / "cubic")
    plain, cubic = ((tmp_path / name / "gyro_estimator.c").read_text() for name in ("plain", "cubic"))
    assert "case 0: { /* " not in plain
    assert cubic.count("case 0: { /* cubic_stiffness */") == 1
    assert "case 1: {" not in cubic


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc is missing")
def test_make_object_is_of_the_compiler_and_the_flags_that_are_given(tmp_path: Path) -> None:
    hil.generate("s-slow", out=tmp_path)
    made = tmp_path / "gyro_estimator.o"

    def machine(*given: str) -> int:
        subprocess.run(["make", "-C", tmp_path, *given, "object"], check=True, capture_output=True)
        return int.from_bytes(made.read_bytes()[18:20], "little")

    host, arm = machine("CFLAGS=-O0"), 40  # EM_ARM
    assert host != arm
    assert machine("CC=arm-none-eabi-gcc", "CFLAGS=-O0 -mcpu=cortex-m7 -mthumb") == arm
    at = made.stat().st_mtime_ns
    assert machine("CC=arm-none-eabi-gcc", "CFLAGS=-O0 -mcpu=cortex-m7 -mthumb") == arm
    assert made.stat().st_mtime_ns == at, "compiled without need"
    assert machine("CC=arm-none-eabi-gcc", "CFLAGS=-O1 -mcpu=cortex-m7 -mthumb") == arm
    assert made.stat().st_mtime_ns > at
    assert machine("CFLAGS=-O0") == host


def test_a_header_of_another_version_is_told_in_one_line(tmp_path: Path) -> None:
    hil.generate(load_bench(EXAMPLES / "s-slow.bench.toml"), out=tmp_path)
    header = tmp_path / "gyro_estimator.h"
    header.write_text(header.read_text().replace("GYRO_ESTIMATOR_VERSION 2u", "GYRO_ESTIMATOR_VERSION 3u"))
    done = subprocess.run(
        ["cc", "-c", "-o", "/dev/null", tmp_path / "test_golden.c"], capture_output=True, text=True, check=False
    )
    assert "golden.h is of another version than gyro_estimator.h: generate both again" in done.stderr


@pytest.mark.parametrize(("name", "value"), [("latency", 3), ("sense_scale", 1e-6), ("drive_scale", 1e-6)])
def test_what_the_board_of_a_link_tells_is_refused(tmp_path: Path, name: str, value: float) -> None:
    given: dict[str, Any] = {name: value}
    with pytest.raises(InputError, match=f"link: the board tells its latency and scales; take {name}= out"):
        hil.generate("s-slow", out=tmp_path, link="inproc:s-slow", **given)
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="axes = 1: only the estimator of a gyro"):
        hil.generate("silverbox", out=tmp_path)
    bench = load_bench(EXAMPLES / "s-slow.bench.toml")
    warm = override(bench, {"effects": {"temperature_stiffness": {}}}, "test")
    with pytest.raises(InputError, match=r"\[effects.temperature_stiffness\] depends on the temperature"):
        hil.generate(warm, out=tmp_path)


def test_the_command_writes_the_folder_and_keeps_one_that_exists(tmp_path: Path) -> None:
    out = tmp_path / "estimator"
    assert hil_says("generate", "s-slow", "--out", str(out)).returncode == 0
    assert {path.name for path in out.iterdir()} == {
        "gyro_estimator.h", "gyro_estimator.c", "golden.h", "test_golden.c", "Makefile", "README.txt",
        "gyro_plugin.c", "gyro_plugin.h",
    }  # fmt: skip
    again = hil_says("generate", "s-slow", "--out", str(out))
    assert again.returncode == 2
    assert "exists already; give another name, or --replace" in again.stderr


def test_a_full_disk_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str) -> None:
        raise OSError(errno.ENOSPC, "no space left on device", str(path))

    monkeypatch.setattr("hil.generating.c_code.write_text", full)
    with pytest.raises(InputError, match="no space left"):
        hil.generate("s-slow", out=tmp_path / "estimator")
    assert not list(tmp_path.iterdir())
