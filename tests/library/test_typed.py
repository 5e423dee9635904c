"""A user's own file is checked against the library's types, as strictly as this repository is (PEP 561)."""

import importlib
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]

USES = '''\
"""What the library's page shows, in the file of somebody who uses it."""

import numpy as np
import numpy.typing as npt

import hil


def look(place: str) -> float:
    run = hil.load(place)
    of_run: tuple[hil.Series, ...] = (run.angle, run.rate, run.estimates, run.innovation, run.capture)
    frames = [series.to_pandas() for series in of_run]
    print(frames, run.report().name, run.verdict, run.result.samples, run.capture["vx_V"].mean())
    return float(run.angle.values[-1])


def close_the_loop(t_s: npt.NDArray[np.float64], x_V: npt.NDArray[np.float64]) -> hil.Run:
    bench = hil.load_bench("s-slow").with_(loop={"duration_s": 5.0}, effects={"cubic_stiffness": {"k3x": 1e12}})
    run = hil.run(bench, link="inproc:s-slow", clock="lockstep")
    diagnosis = hil.trace(run, bench)
    for effect in diagnosis.effects:
        for symbol, found in effect.coefficients.items():
            print(effect.name, symbol, found.value, found.ci95, found.unit)
    diagnosis.plot().savefig("trace.png")
    hil.trace({"t_s": t_s, "vx_V": x_V, "ux_N": x_V}, "my.bench.toml", hold="foh").report()
    hil.trace(run.capture.to_pandas(), bench, nonuniform=True)
    hil.replay(run.capture, bench)
    print([run.capture[name].mean() for name in run.capture.columns])
    kept = hil.load_trace(diagnosis.path)
    again: hil.Run = hil.replay("last", kept.add_to(run.bench))
    print(hil.compare(again, truth="truth.arrow").of("full").angle_error_rms_rad)
    print([one.name for one in hil.diff(run, again).figures if one.apart], hil.export(run, "run.csv").name)
    print(hil.sweep("s-slow-noise").worst[0].command)
    return hil.score(again, "truth.arrow")


def told(block: hil.Block) -> None:
    print(block.angle.t_s[-1], block.innovation.values.std())


def watch() -> None:
    for block in hil.open("s-slow", link="pty:s-slow", duration_s=20.0).stream():
        told(block)
    with hil.open("s-slow", link="pty:s-slow") as live:
        next(live.stream())
    print(live.run.verdict)
'''

WRONG = """\
import hil

hil.load("last").angel
hil.run("s-slow", duration_s="5")
hil.load_trace("last-trace").angle
"""


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_says_that_it_has_types(package: str) -> None:
    marker = Path(next(iter(importlib.import_module(package).__path__))) / "py.typed"
    assert marker.read_bytes() == b""


@pytest.mark.long
def test_what_the_library_offers_is_typed_for_who_uses_it(tmp_path: Path) -> None:
    (tmp_path / "uses.py").write_text(USES, encoding="utf-8")
    (tmp_path / "wrong.py").write_text(WRONG, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--no-error-summary", "uses.py", "wrong.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},  # found there as an installed package is: by its marker alone
        capture_output=True,
        text=True,
    )
    assert done.stderr == ""
    told = [line.partition(": error: ")[0] for line in done.stdout.splitlines() if ": note: " not in line]
    assert told == ["wrong.py:3", "wrong.py:4", "wrong.py:5"], done.stdout
