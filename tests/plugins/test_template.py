"""`hil init --plugin`: what it writes runs as it is."""

import json
import subprocess
from pathlib import Path

import pytest

import hil
from tests.forked import hil_says
from tests.plugins.compiled import library
from tests.plugins.running import bench, ran

pytestmark = [pytest.mark.usefixtures("no_report"), pytest.mark.slow]


def init(place: Path, *options: str) -> "subprocess.CompletedProcess[str]":
    return hil_says("init", *options, cwd=place)


@pytest.mark.parametrize("ending", [".py", ".c"])
def test_a_template_closes_the_loop(tmp_path: Path, ending: str) -> None:
    names = {}
    for kind in ("observer", "controller"):
        done = init(tmp_path, "--plugin", kind, "-o", f"my_{kind}{ending}", "--json")
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout)
        assert all((tmp_path / name).exists() for name in told["written"])
        names[kind] = str(tmp_path / told["plugin"])
        if ending == ".c":
            assert library(tmp_path / f"my_{kind}.c") == names[kind]
    run = ran(tmp_path / "run", bench(names["observer"], names["controller"], duration_s=3.0))
    assert run.estimates is not None
    scored = run.estimates.t_s > 1.0
    assert abs(run.estimates["energy_ratio"][scored] - 1.0).max() < 0.01
    assert abs(run.estimates["quadrature_ratio"][scored]).max() < 0.02
    assert run.result is not None
    assert run.result.parts["safety"].outcome == "good"


@pytest.mark.parametrize("ending", [".py", ".c"])
def test_the_observer_s_angle_holds_on_springs_that_are_declared_wrong(tmp_path: Path, ending: str) -> None:
    """S-slow as it comes, by the bench's own control law: springs 4 % off, damping half of the device's."""
    done = init(tmp_path, "--plugin", "observer", "-o", f"mine{ending}", "--json")
    name = str(tmp_path / json.loads(done.stdout)["plugin"])
    if ending == ".c":
        assert library(tmp_path / "mine.c") == name
    scored = hil.score(ran(tmp_path / "run", bench(name, duration_s=6.0)).path, tmp_path / "run" / "truth.arrow")
    result = scored.result
    assert result.parts["model"].outcome == "complete"
    assert result.parts["angle"].outcome == "good"
    assert result.angle_error_rms_rad is not None
    assert result.angle_error_rms_rad < 0.03


def test_an_angle_and_a_rate_that_are_wrong_alike_fail_the_angle(tmp_path: Path) -> None:
    """The template with half of both, and sure of it: nothing within the plug-in contradicts that."""
    done = init(tmp_path, "--plugin", "observer", "-o", "mine.py", "--json")
    source = Path(tmp_path / json.loads(done.stdout)["plugin"].partition(":")[0])
    source.write_text(
        f"""{source.read_text()}

class Half(MyObserver):
    def observe(self, sense, applied, imposed):
        seen = super().observe(sense, applied, imposed)
        return seen._replace(rate=0.5 * seen.rate, angle=0.5 * seen.angle, angle_u=1e-6)
"""
    )
    run = ran(tmp_path / "run", bench(f"{source}:Half", duration_s=6.0))
    assert run.result is not None
    assert run.result.parts["model"].outcome == "complete"
    angle, own = run.result.parts["angle"], run.result.own_reading
    assert own is not None
    assert own.plugin_rad == pytest.approx(0.5 * own.own_rad, rel=0.01)
    assert angle.outcome == "failed"
    assert "the bench's own observer reads" in angle.reason
    assert angle.next is not None
    assert angle.next.startswith("hil compare ")


def test_what_cannot_be_written_is_told_in_one_line(tmp_path: Path) -> None:
    for options, words in (
        (["--plugin", "filter"], "--plugin filter: observer or controller"),
        (["--plugin", "observer", "-o", "mine.rs"], "ends with .py or .c"),
    ):
        done = init(tmp_path, *options)
        assert done.returncode == 2
        assert words in done.stderr
        assert done.stderr.count("\n") == 1
    (tmp_path / "observer.py").write_text("mine\n")
    assert init(tmp_path, "--plugin", "observer").returncode == 2
    assert (tmp_path / "observer.py").read_text() == "mine\n"
