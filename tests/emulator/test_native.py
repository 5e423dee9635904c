"""The emulator's inner loop in C: one list of effects with Python, no undefined behaviour, nothing heavy to import."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import device_emulator

PACKAGE = Path(device_emulator.__file__).parent
NATIVE = PACKAGE / "native"

EVERY_EFFECT = """
import dataclasses, pathlib, sys
import numpy as np
from device_emulator.device import Device
from device_emulator.effects.catalogue import HiddenEffect
from device_emulator.effects.kinds import DECLARATIONS
from device_emulator.feedback import Feedback
from device_emulator.scenario import load
from tests.emulator.test_turn import test_random_drives_act_by_the_rules as converse

for latency, block, wide in ((0, 1, False), (1, 1, True), (3, 3, True)):
    converse(latency, block, wide)

plain = load(pathlib.Path(sys.argv[1]))
sizes = {"1/(m²·s²)": 1e12, "1/(m⁴·s²)": 1e20, "1/(m·s²)": 1e8, "Hz": 150.0, "1/s²": 1e5, "m": 3e-5, "s": 1e-4}
sizes |= {"m/s³": 3e4, "V·s²/m": 1e-4, "m/s²": 0.1, "m/s": 1e-2, "s²/m": 1e-3}
codes = np.random.default_rng(1).integers(-30000, 30000, (300, 2))
for name, declaration in DECLARATIONS.items():
    values = {c.symbol: 1.0 if c.switch else sizes.get(c.unit, 0.01) for c in declaration.coefficients}
    values |= {"every": 8.0, "width": 3.0} if "every" in values else {}
    device = Device(plain.model_copy(update={"effect": [HiddenEffect(name, values)]}))
    device.rows(codes)
    loop = Feedback(1, 100)
    loop.record["closed"], loop.record["limit"], loop.record["gain"] = 1, 100, 0.1
    device.closed_rows(loop.record, 100)
print("all", len(DECLARATIONS))
"""


def test_a_board_imports_no_compiler_and_no_estimator() -> None:
    heavy = "{'numba', 'llvmlite', 'sympy', 'scipy', 'pandas', 'estimator', 'matplotlib'}"
    program = f"import sys, device_emulator.inprocess, device_emulator.serve; print({heavy} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.slow
def test_every_effect_runs_without_undefined_behaviour(tmp_path: Path) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc with its sanitizers: sudo apt install gcc")
    shutil.copytree(PACKAGE, tmp_path / "device_emulator", ignore=shutil.ignore_patterns("__pycache__", "*.so.1"))
    firmware = PACKAGE.parent / "firmware" / "src"
    checks = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all", "-g", "-O1"]
    library = tmp_path / "device_emulator" / "native" / "libdevice.so.1"
    sources = [NATIVE / "device.c", *(firmware / f"hil_{name}.c" for name in ("spec", "frame", "crc32c"))]
    subprocess.run([compiler, "-std=c99", *checks, "-fPIC", "-shared", "-o", library, *sources, "-lm"], check=True)
    (tmp_path / "run.py").write_text(EVERY_EFFECT, encoding="utf-8")
    asan = subprocess.run([compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    environment = os.environ | {
        "LD_PRELOAD": asan.stdout.strip(),
        "ASAN_OPTIONS": "detect_leaks=0",  # Python's own
        "PYTHONPATH": os.pathsep.join([str(tmp_path), str(PACKAGE.parent)]),
    }
    scenario = PACKAGE.parent / "examples" / "s-slow.scenario.toml"
    done = subprocess.run(
        [sys.executable, tmp_path / "run.py", scenario], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.startswith("all")
