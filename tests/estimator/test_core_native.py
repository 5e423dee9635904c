"""The core as a library: numbers that C and Python share, one result of all instruction sets, no undefined behaviour,
a build that says what it lacks.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import sympy as sp

import estimator
from estimator.core import variant
from estimator.core.compiler import FLAGS
from estimator.core.generate.printer import assignments
from estimator.effects.declaration import Source

ESTIMATOR = Path(estimator.__file__).parent
CORE = ESTIMATOR / "core"
ROOT = ESTIMATOR.parent

RUNS = """
import hashlib, sys
import numpy as np
from estimator.core import variant
if "baseline" in sys.argv:
    variant.VARIANTS = {}
from estimator.core import library
from estimator.effects.catalogue import EFFECTS
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings

random, digest = np.random.default_rng(7), hashlib.sha256()
phase = 0.1 * np.pi * np.arange(60)  # of a vibration at 200 Hz and of the nominal amplitude
sense = -0.089 * np.column_stack([np.cos(phase), 0.3 * np.sin(phase)]) + 1e-4 * random.standard_normal((60, 2))
drive = 0.05 * random.standard_normal((60, 2))
control = ControllerSettings(latency=1, force_quantum=1e-4, force_limit=10.0, sense_quantum=1e-6, dither=0.1)
for axes in (2, 1):
    w = 1.6e6
    stiffness, damping = ((w * 1.02, w * 0.98, w * 0.01), (1.3, 1.1, 0.06)) if axes == 2 else ((w,), (1.3,))
    device = Device(4000.0, stiffness, damping, 1e-4, (-890.0,) * axes, (1e-4,) * axes)
    present = [effect for effect in EFFECTS if effect.on(axes) is not None]
    for effect in (None, *present):
        given = () if effect is None else effect.parameters
        parameters = {p.name: p.choices[0] if p.choices else 900.0 if p.name == "omega" else 1e-3 for p in given}
        effects = {} if effect is None else {effect.name: parameters}
        for gain in (Gain.EKF, Gain.FADING):
            observer = Observer(device, ObserverSettings(gain=gain, effects=effects), control if axes == 2 else None)
            observer.run(sense[:, :axes], drive[:, :axes])
            if axes == 2 and gain is Gain.FADING:
                for m in range(5):
                    try:
                        observer.tick(100.0 * m, -50.0 * m, 3.0, -2.0)
                    except ValueError:
                        break
            found = np.concatenate([observer.x, observer.covariances[0].ravel()])
            assert np.isfinite(found).all(), effects
            digest.update(found.tobytes())
print(library.PATH.name, digest.hexdigest())
"""


def ran(*arguments: str, **environment: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", RUNS, *arguments],
        capture_output=True, text=True, check=False, cwd=CORE, env=os.environ | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout.split()


def test_c_numbers_each_source_of_a_signal_as_python_does() -> None:
    listed = re.search(r"enum source \{(.*?)\};", (CORE / "signals.h").read_text(encoding="utf-8"), re.DOTALL)
    assert listed is not None
    assert dict(re.findall(r"(\w+) = (\d+)", listed[1])) == {source.name: str(source.value) for source in Source}


def test_a_condition_that_is_shared_is_no_number() -> None:
    """As clang wants it, which refuses a number as a condition."""
    x = sp.Symbol("x")
    pairs = [(f"const real {name}", sp.Piecewise((scale * x, x > 1), (0, True))) for name, scale in enumerate((2, 3))]
    named = [line.split(" = ")[0] for line in assignments(pairs, "t")]
    assert named == ["const int t0", "const real 0", "const real 1"]


def test_the_best_library_is_one_that_the_processor_can_run(tmp_path: Path) -> None:
    name, flags = next(iter(variant.VARIANTS.items()))
    (tmp_path / name).touch()
    assert variant.best(tmp_path, flags).name == name
    assert variant.best(tmp_path, flags[1:]).name == variant.BASELINE
    assert variant.best(tmp_path / "none", flags).name == variant.BASELINE


@pytest.mark.slow
def test_all_instruction_sets_give_one_result_to_the_last_bit() -> None:
    (best, found), (least, same) = ran(), ran("baseline")
    if best == least:
        pytest.skip(f"this processor has none of {', '.join(variant.VARIANTS)}")
    assert found == same


@pytest.mark.slow
def test_observer_and_control_run_without_undefined_behaviour(tmp_path: Path) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc with its sanitizers: sudo apt install gcc")
    shutil.copytree(ESTIMATOR, tmp_path / "estimator", ignore=shutil.ignore_patterns("__pycache__", "*.so.1"))
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1", "-Wno-psabi"]
    library = tmp_path / "estimator" / "core" / variant.BASELINE
    options = [flag for flag in FLAGS if not flag.startswith("-O")]
    subprocess.run([compiler, *options, *checks, "-o", library, CORE / "core.c", "-lm"], check=True)
    asan = subprocess.run([compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    # Leaks are Python's own.
    where = {"PYTHONPATH": str(tmp_path), "LD_PRELOAD": asan.stdout.strip(), "ASAN_OPTIONS": "detect_leaks=0"}
    assert ran(**where)[0] == variant.BASELINE


def test_a_build_without_a_compiler_says_so_in_one_line(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "CC"} | {"PATH": str(tmp_path)}
    program = "import sys; sys.modules['ziglang'] = None; import compile_native; compile_native.main()"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode != 0
    assert re.fullmatch(r"compile_native: no C compiler: .*apt install gcc.*gyrohil\[compiler\].*\n", done.stderr)
