"""An effect that the bench file names is estimated, and the loop and the angle are rid of it."""

from pathlib import Path

import pytest

from hil.bench import load_bench, override
from hil.examples import find
from hil.loop.run import run
from hil.records.result import Result
from hil.score import score

pytestmark = pytest.mark.slow  # whole runs


def scored(tmp_path: Path, effect: str, declared: dict[str, dict[str, float]], excited: bool = True) -> Result:
    """A lockstep run of S-slow with one hidden effect, 20 s, scored over its second half."""
    scenario = tmp_path / "hidden.scenario.toml"
    constant = '[rate]\nkind = "constant"\nrate_rad_s = 1.0\n'
    before, _, _ = Path(find("scenario", "s-slow")).read_text().partition("[rate]")
    scenario.write_text(f"{before}{constant}\n[[effect]]\n{effect}\n")
    changes = {
        "loop": {"clock": "lockstep", "duration_s": 20.0, "settle_s": 10.0},
        "controller": {"amplitude_modulation": 0.3 if excited else 0.0},
        "limits": {"residual_safe": 1e4},
        "effects": declared,
    }
    bench = override(load_bench(Path(find("bench", "s-slow"))), changes, "test")
    truth = tmp_path / f"truth-{len(list(tmp_path.iterdir()))}.arrow"  # of each run its own: none is written over
    done = run(bench, f"inproc:{scenario}", tmp_path, truth=truth, progress=lambda _: None)
    assert done.folder is not None
    return score(done.folder, truth)


@pytest.mark.parametrize(
    ("effect", "name", "symbol", "true", "gain"),
    [
        ('name = "cubic_stiffness"\nk3x = 1e13\nk3y = 3e12', "cubic_stiffness", "k3x", 1e13, 10.0),
        ('name = "sense_gain"\ngx = 0.0\ngy = 0.01', "sense_gain", "gy", 0.01, 10.0),
        ('name = "drive_gain"\ngx = 0.03\ngy = -0.02', "drive_gain", "hx", 0.03, 1.0),
    ],
)
def test_a_declared_effect_is_found_and_undone(
    tmp_path: Path, effect: str, name: str, symbol: str, true: float, gain: float
) -> None:
    without = scored(tmp_path, effect, {})
    carried = scored(tmp_path, effect, {name: {}})
    found = carried.parameters[symbol]
    half_width = 0.5 * (found.ci95[1] - found.ci95[0])
    assert abs(found.value - true) < 2.5 * half_width
    assert half_width < 0.1 * abs(true)
    assert carried.innovation_rms is not None
    assert carried.noise_floor is not None
    assert carried.innovation_rms < 1.05 * carried.noise_floor
    assert without.angle_error_rms_rad is not None
    assert carried.angle_error_rms_rad is not None
    assert carried.angle_error_rms_rad < without.angle_error_rms_rad / gain


def test_the_bench_as_run_keeps_its_effects(tmp_path: Path) -> None:
    scenario = find("scenario", "s-slow")
    changes = {
        "loop": {"clock": "lockstep", "duration_s": 0.1, "settle_s": 0.0},
        "effects": {"sense_gain": {"gy": 0.01}},
    }
    bench = override(load_bench(Path(find("bench", "s-slow"))), changes, "test")
    done = run(bench, f"inproc:{scenario}", tmp_path, progress=lambda _: None)
    assert done.folder is not None
    assert load_bench(done.folder / "bench.toml").effects == {"sense_gain": {"gy": 0.01}}
