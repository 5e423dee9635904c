"""An effect that the bench file names is estimated, and the loop and the angle are rid of it."""

from pathlib import Path
from typing import Any

import pytest

from hil.bench import load_bench, override
from hil.bench.examples import find
from hil.records.result import Result
from hil.running.request import RunRequest
from hil.running.run import run
from hil.scoring.score import score

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_report")]  # whole runs, of which no page is looked at


def scored(
    tmp_path: Path,
    effect: str,
    declared: dict[str, dict[str, float]],
    excited: bool = True,
    device: dict[str, Any] | None = None,
    loop: dict[str, Any] | None = None,
) -> Result:
    """A lockstep run of S-slow with one hidden effect, 20 s, scored over its second half; effect: the lines of its
    `[[effect]]`, or a section of its own.
    """
    scenario = tmp_path / "hidden.scenario.toml"
    constant = '[rate]\nkind = "constant"\nrate_rad_s = 1.0\n'
    before, _, _ = Path(find("scenario", "s-slow")).read_text().partition("[rate]")
    section = effect if effect.startswith("[") else f"[[effect]]\n{effect}"
    scenario.write_text(f"{before}{constant}\n{section}\n")
    changes = {
        "loop": {"clock": "lockstep", "duration_s": 20.0, "settle_s": 10.0, **(loop or {})},
        "controller": {"amplitude_modulation": 0.3 if excited else 0.0},
        "limits": {"residual_safe": 1e4},
        "effects": declared,
    }
    bench = override(load_bench(Path(find("bench", "s-slow"))), changes | (device or {}), "test")
    truth = tmp_path / f"truth-{len(list(tmp_path.iterdir()))}.arrow"  # of each run its own: none is written over
    done = run(RunRequest(bench, f"inproc:{scenario}", {"truth": truth}), tmp_path, progress=lambda _: None)
    assert done.folder is not None
    return score(done.folder, truth)


NOBODY_ASKS = pytest.mark.usefixtures("no_scan")  # whether the model is complete


@pytest.mark.long
@NOBODY_ASKS
@pytest.mark.parametrize(
    ("effect", "name", "symbol", "true", "gain"),
    [
        ('name = "cubic_stiffness"\nk3x = 1e13\nk3y = 3e12', "cubic_stiffness", "k3x", 1e13, 10.0),
        ('name = "sense_gain"\ngx = 0.0\ngy = 0.01', "sense_gain", "gy", 0.01, 10.0),
        ('name = "drive_gain"\nhx = 0.03\nhy = -0.02', "drive_gain", "hx", 0.03, 1.0),
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
    done = run(RunRequest(bench, f"inproc:{scenario}"), tmp_path, progress=lambda _: None)
    assert done.folder is not None
    assert load_bench(done.folder / "bench.toml").effects.named == {"sense_gain": {"gy": 0.01}}


CLOCK = ("[faults]\nclock_skew = 0.01", {"clock_rate": {"delta": 1.0 / 1.01 - 1.0}})
MASSES = ('name = "unequal_masses"\nm = 0.1', {"unequal_masses": {"m": 0.1}})


@pytest.mark.long
@NOBODY_ASKS
@pytest.mark.timeout(900)  # three runs with their scans: a minute on four quiet processors
@pytest.mark.parametrize(
    ("effect", "declared", "gain"), [(*CLOCK, 10.0), (*MASSES, 10.0)], ids=["clock_rate", "unequal_masses"]
)
def test_what_no_record_can_tell_is_undone_once_it_is_declared(
    tmp_path: Path, effect: str, declared: dict[str, dict[str, float]], gain: float
) -> None:
    """The angle is right with it, wrong without it, and as wrong with the other sign of it."""
    turned = {name: {symbol: -value for symbol, value in given.items()} for name, given in declared.items()}
    without = scored(tmp_path, effect, {}).angle_error_rms_rad
    wrong = scored(tmp_path, effect, turned).angle_error_rms_rad
    carried = scored(tmp_path, effect, declared)
    right = carried.angle_error_rms_rad
    assert without is not None
    assert wrong is not None
    assert right is not None
    assert right < without / gain
    assert wrong > without
    assert carried.innovation_rms is not None
    assert carried.noise_floor is not None
    assert carried.innovation_rms < 1.05 * carried.noise_floor


@pytest.mark.long
@NOBODY_ASKS
def test_with_the_clock_declared_the_stiffness_is_per_second_of_true_time(tmp_path: Path) -> None:
    kxx = scored(tmp_path, *CLOCK).parameters["kxx"]
    assert kxx.truth is not None
    assert kxx.value == pytest.approx(kxx.truth, rel=1e-5)


POLARITIES = [(channel, px, py) for channel in ("drive", "sense") for px, py in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))]


@pytest.mark.long
@NOBODY_ASKS
@pytest.mark.parametrize("mode", ["force", "gain"])
@pytest.mark.parametrize(("channel", "px", "py"), POLARITIES)
def test_a_channel_that_is_turned_round_is_no_matter_once_it_is_declared(
    tmp_path: Path, channel: str, px: float, py: float, mode: str
) -> None:
    hidden = f'name = "{channel}_polarity"\npx = {px}\npy = {py}'
    loop: dict[str, Any] = {"duration_s": 12.0, "settle_s": 6.0, "mode": mode}
    loop |= {"block": 20, "estimate_every": 20} if mode == "gain" else {}
    done = scored(tmp_path, hidden, {f"{channel}_polarity": {"px": px, "py": py}}, loop=loop)
    assert done.angle_error_rms_rad is not None
    assert done.angle_error_rms_rad < 5e-3  # noise alone leaves 2 to 3 mrad
    assert done.innovation_rms is not None
    assert done.noise_floor is not None
    assert done.innovation_rms < 1.05 * done.noise_floor


@pytest.mark.long
@NOBODY_ASKS
@pytest.mark.parametrize("channel", ["drive", "sense"])
def test_a_polarity_that_is_declared_of_the_wrong_axis_loses_the_loop(tmp_path: Path, channel: str) -> None:
    hidden = f'name = "{channel}_polarity"\npx = 1.0'
    done = scored(tmp_path, hidden, {f"{channel}_polarity": {"py": 1.0}})
    assert done.angle_error_rms_rad is None or done.angle_error_rms_rad > 0.3


@NOBODY_ASKS
@pytest.mark.long
def test_the_sign_of_the_gain_of_an_axis_is_the_polarity_of_its_sense(tmp_path: Path) -> None:
    hidden = 'name = "sense_polarity"\npy = 1.0'
    gains = {"device": {"sense": {"gain_V_per_m": [-885.42, 885.42], "noise_V": 9e-5, "offset_sd_V": 0.02}}}
    by_sign = scored(tmp_path, hidden, {}, device=gains)
    assert by_sign.angle_error_rms_rad is not None
    assert by_sign.angle_error_rms_rad < 5e-3
