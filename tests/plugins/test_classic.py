"""The loops of [controller] mode on emulated devices, beside closed forms: Lynch's equations, and their design."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.completeness.closing import as_loops
from estimator.completeness.turning import followed, instants
from estimator.record import Record
from estimator.trace.problem import Problem
from hil.bench import Bench, override
from hil.comparing.methods import compare
from hil.errors import InputError
from hil.inputs.declared import device_of, observer_settings_of
from hil.plugins.protocol import PluginError
from hil.records.runfolder import RunFolder
from hil.report.page import render
from hil.scoring.score import score
from hil.toml.reading import toml_value
from tests.plugins.direct import Driven, drive_directly
from tests.plugins.running import OWN, bench, ran
from tests.running import gyro

MASS_KG, RATE_RAD_S = 1e-3, 0.5
ROUND = {"stiffness_N_per_m": (1579.1367, 1579.1367, 0.0), "damping_N_s_per_m": (1.25664e-3, 1.25664e-3, 0.0)}
SPLIT = {"stiffness_N_per_m": (1610.7194, 1547.5540, 15.7914), "damping_N_s_per_m": (1.3823e-3, 1.13097e-3, 6.2832e-5)}
LOOPS = ("amplitude", "phase", "rate", "quadrature")
_NONE: Mapping[str, Any] = {}


def driven(
    place: Path,
    mode: str,
    duration_s: float,
    device: Mapping[str, Any],
    *,
    truth: Mapping[str, Any] = _NONE,
    loops: Mapping[str, Any] = _NONE,
    rate_rad_s: float = RATE_RAD_S,
    rate: Mapping[str, Any] | None = None,
    damping_sd: float = 1e-3,
) -> Driven:
    """S-slow from rest, its stiffness and damping declared as they are, where `truth` does not say otherwise."""
    real = {key: list(value) for key, value in device.items()} | {"position_m": [0.0, 0.0]} | dict(truth)
    scenario = gyro.scenario(
        place / "board.toml", truth=real, rate=dict(rate or {"kind": "constant", "rate_rad_s": rate_rad_s})
    )
    return drive_directly(declared(mode, device, loops, damping_sd), scenario, duration_s)


def declared(
    mode: str, device: Mapping[str, Any] = SPLIT, loops: Mapping[str, Any] = _NONE, damping_sd: float = 1e-3
) -> Bench:
    """damping_sd: of the mean damping."""
    changes: dict[str, Any] = {"mode": mode, "virtual_rotation_rad_s": 0.0, "dither_mps2": 0.0, "loops": loops}
    observer = {"initial_sd": {"damping": damping_sd}}
    return override(gyro.bench(10.0), {"controller": changes, "device": device, "observer": observer}, "test")


@pytest.mark.parametrize("device", [ROUND, SPLIT], ids=["round", "split"])
def test_the_balancing_force_is_the_rate_and_the_coupling_damping(tmp_path: Path, device: Mapping[str, Any]) -> None:
    """ẏ averaged: A (Ω + dxy/2) = force/2ω (Lynch 1995, the sense axis held at zero)."""
    found = driven(tmp_path, "force_to_rebalance", 8.0, device)
    bias = 0.5 * device["damping_N_s_per_m"][2] / MASS_KG
    rate = found.rate[24000:]
    assert np.mean(rate) == pytest.approx(RATE_RAD_S + bias, abs=1e-3)
    assert np.sqrt(np.mean(found.energy[24000:] - 1.0) ** 2) < 1e-3
    assert np.max(np.abs(found.quadrature[24000:])) < 0.01
    turned = found.angle[-1] - found.angle[24000]
    assert turned == pytest.approx((RATE_RAD_S + bias) * 2.0, abs=4e-3)
    assert np.abs(turned - 2.0 * RATE_RAD_S) < 2.0 * found.angle_u[-1]


@pytest.mark.parametrize("device", [ROUND, SPLIT], ids=["round", "split"])
@pytest.mark.parametrize("mode", ["force_to_rebalance", "classic_whole_angle"])
def test_its_uncertainty_is_the_turn_by_damping_since_its_zero(
    tmp_path: Path, mode: str, device: Mapping[str, Any]
) -> None:
    """[loop] settle_s, 4 s: the angle has ∫ ½ dxy cos 2α − ¼ Δd sin 2α dt more, with dxx, dyy and dxy each ± 0.1 d."""
    found = driven(tmp_path, mode, 8.0, device, damping_sd=0.1)
    dxx, dyy, dxy = (value / MASS_KG for value in device["damping_N_s_per_m"])
    sd = 0.1 * 0.5 * (dxx + dyy)
    azimuth = -found.angle[16000:] if mode == "classic_whole_angle" else np.zeros(16000)
    sine, cosine = (float(np.sum(wave(2.0 * azimuth))) / gyro.RATE_HZ for wave in (np.sin, np.cos))
    grown = math.hypot(0.5 * math.hypot(dxy, sd) * cosine, 0.25 * math.hypot(dxx - dyy, math.sqrt(2.0) * sd) * sine)
    assert found.angle_u[-1] == pytest.approx(grown, rel=0.02)


@pytest.mark.parametrize("mode", ["force_to_rebalance", "classic_whole_angle"])
def test_damping_that_is_declared_isotropic_is_still_uncertain(tmp_path: Path, mode: str) -> None:
    """A true damping 10 % apart and 5 % coupled, within its uncertainty: its turn is within that of the angle."""
    isotropic = SPLIT | {"damping_N_s_per_m": (1.25e-3, 1.25e-3, 0.0)}
    truth = {"damping_N_s_per_m": list(SPLIT["damping_N_s_per_m"])}
    found = driven(tmp_path, mode, 12.0, isotropic, truth=truth, rate_rad_s=0.02, damping_sd=0.1)
    error = found.angle[-1] - found.angle[16000] - 0.02 * 8.0
    assert 0.1 < abs(error) < 2.0 * found.angle_u[-1] < 1.5


def moved_by(found: Driven, bench: Bench, effects: Iterable[str]) -> dict[str, np.ndarray]:
    """Of each effect, what a unit of each coefficient does to the angle from 4 s on, as the closing scan has it."""
    record = Record(found.sense, found.drive, np.full(len(found.sense), 1.0 / gyro.RATE_HZ))
    values = (*bench.device.stiffness_per_s2, *bench.device.damping_per_s)
    constants = dict(zip(("kxx", "kyy", "kxy", "dxx", "dyy", "dxy"), values, strict=True))
    problem = as_loops(Problem(record, device_of(bench), observer_settings_of(bench), None), constants)
    columns, course = followed(problem, {name: {} for name in effects})
    begin = np.searchsorted(instants(len(record)), 16000)
    return {name: course[-1, places] - course[begin, places] for name, places in columns.items()}


def test_what_a_constant_does_to_the_balancing_force(tmp_path: Path) -> None:
    """Of ẏ averaged, along x: (hy (Ω + dxy/2) + my dxx/2 + ey dyy/2 − (τy of the drive + τx of the sense) kxy/2) t."""
    found, bench = driven(tmp_path, "force_to_rebalance", 8.0, SPLIT), declared("force_to_rebalance")
    (_, _, kxy), (dxx, dyy, dxy) = bench.device.stiffness_per_s2, bench.device.damping_per_s
    expected = {
        "drive_gain": (0.0, RATE_RAD_S + 0.5 * dxy), "sense_gain": (0.0,), "drive_misalignment": (0.0, 0.5 * dxx),
        "sense_cross_coupling": (0.0, 0.5 * dyy), "drive_delay": (0.0, -0.5 * kxy), "sense_delay": (-0.5 * kxy, 0.0),
    }  # fmt: skip
    for name, turned in moved_by(found, bench, expected).items():
        size = max(map(abs, (*expected[name], 0.5)))
        assert turned == pytest.approx(np.multiply(expected[name], 4.0), abs=0.02 * 4.0 * size), name


def test_what_a_constant_does_to_a_motion_that_turns_freely(tmp_path: Path) -> None:
    """At α the drive is d along the motion, d = dxx cos² α + dyy sin² α + dxy sin 2α; of it a gain or an angle puts
    ½ d (hy − hx) sin α cos α and ½ d (my cos² α − mx sin² α) across the motion."""
    found, bench = driven(tmp_path, "classic_whole_angle", 8.0, SPLIT), declared("classic_whole_angle")
    dxx, dyy, dxy = bench.device.damping_per_s
    azimuth = -found.angle[16000:]
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    along = 0.5 * (dxx * cosine**2 + dyy * sine**2 + 2.0 * dxy * sine * cosine) / gyro.RATE_HZ
    apart = float(np.sum(along * sine * cosine))
    expected = {
        "drive_gain": (-apart, apart),
        "drive_misalignment": (-float(np.sum(along * sine**2)), float(np.sum(along * cosine**2))),
    }
    for name, turned in moved_by(found, bench, expected).items():
        assert turned == pytest.approx(expected[name], rel=0.1), name  # it has a memory of a second


def test_exchanging_the_axes_takes_that_bias_off(tmp_path: Path) -> None:
    found = driven(tmp_path, "mode_reversal", 45.0, SPLIT, loops={"exchange_s": 8.0})
    assert np.mean(found.rate[20000:36000]) == pytest.approx(RATE_RAD_S + 0.0314, abs=1e-3)
    assert np.mean(found.rate[-32000:]) == pytest.approx(RATE_RAD_S, abs=1e-3)


def test_a_rate_that_changes_while_it_is_held_is_in_the_uncertainty(tmp_path: Path) -> None:
    """A step of 0.5 rad/s at 10 s, in the exchange that begins at the eighth second of running."""
    found = driven(
        tmp_path, "mode_reversal", 16.0, ROUND, loops={"exchange_s": 8.0},
        rate={"kind": "steps", "times_s": [0.0, 10.0], "rates_rad_s": [0.5, 1.0]},
    )  # fmt: skip
    turned = found.angle[64000 - 1] - found.angle[24000]
    error = turned - (0.5 * 4.0 + 1.0 * 6.0)
    assert abs(error) > 0.1  # it is missed
    assert abs(error) < 2.0 * found.angle_u[64000 - 1] < 10.0 * abs(error)


@pytest.mark.long
def test_over_60_K_the_bias_is_ten_times_smaller_with_the_axes_exchanged(tmp_path: Path) -> None:
    """Stiffness -60 ppm/K, damping 0.4 %/K from 25 °C to 85 °C; drive and sense gains off by 2 and 3 %."""
    heat = {"warm_up_K": 94.9, "time_constant_s": 100.0}
    effects = (
        {"name": "temperature_stiffness", "tc": -6e-5},
        {"name": "temperature_damping", "tc": 4e-3},
        {"name": "drive_gain", "hx": 0.02, "hy": -0.03},
        {"name": "sense_gain", "gx": 0.0, "gy": 0.02},
    )
    truth = {key: list(value) for key, value in SPLIT.items()} | {"position_m": [0.0, 0.0]}
    board = gyro.scenario(
        tmp_path / "board.toml", truth=truth, temperature=heat, rate={"kind": "constant", "rate_rad_s": 0.0}
    )
    tables = "".join("\n[[effect]]\n" + "\n".join(f"{k} = {toml_value(v)}" for k, v in one.items()) for one in effects)
    board.write_text(board.read_text("utf-8") + tables + "\n", "utf-8")
    bias = {}
    for mode in ("force_to_rebalance", "mode_reversal"):
        rate = drive_directly(declared(mode, SPLIT, {"exchange_s": 6.0}), board, 100.0).rate[160_000:]
        tenths = rate[: len(rate) // 10 * 10].reshape(10, -1).mean(axis=1)
        bias[mode] = float(np.sqrt(np.mean(tenths**2)))
    assert bias["force_to_rebalance"] > 10.0 * bias["mode_reversal"], bias


def test_the_whole_angle_turns_with_the_board(tmp_path: Path) -> None:
    """θ̇ = -Ω + (Δd/4) sin 2θ - (dxy/2) cos 2θ (Lynch 1995): over whole turns √(Ω² - a²), a half of the anisodamping."""
    rate, device = 1.0, ROUND | {"damping_N_s_per_m": SPLIT["damping_N_s_per_m"]}
    found = driven(tmp_path, "classic_whole_angle", 6.0 + 2.1 * math.pi, device, rate_rad_s=rate)
    dxx, dyy, dxy = (value / MASS_KG for value in device["damping_N_s_per_m"])
    swing = 0.5 * math.hypot(0.5 * (dxx - dyy), dxy)
    n = round(2.0 * math.pi / math.sqrt(rate * rate - swing * swing) * gyro.RATE_HZ)
    turn = slice(24000, 24000 + n)
    assert found.angle[24000 + n] - found.angle[24000] == pytest.approx(2.0 * math.pi, abs=0.01)
    angle = 2.0 * found.angle[turn]
    fitted = np.linalg.lstsq(np.stack([np.ones(n), np.cos(angle), np.sin(angle)], 1), found.rate[turn])[0]
    assert fitted[0] == pytest.approx(rate, abs=2e-3)
    assert math.hypot(fitted[1], fitted[2]) == pytest.approx(swing, rel=0.05)


@pytest.mark.parametrize(("bandwidth_Hz", "margin_deg"), [(2.0, 60.0), (4.0, 50.0), (1.0, 70.0)])
@pytest.mark.parametrize("loop", [*LOOPS, "pattern"])
def test_a_loop_has_the_bandwidth_and_the_phase_margin_it_was_designed_for(
    tmp_path: Path, loop: str, bandwidth_Hz: float, margin_deg: float
) -> None:
    mode = "classic_whole_angle" if loop == "pattern" else "force_to_rebalance"
    loops = {"probe": "rate" if loop == "pattern" else loop, "probe_Hz": bandwidth_Hz, "phase_margin_deg": margin_deg}
    wide = {f"{one}_Hz": bandwidth_Hz for one in LOOPS}
    found = driven(tmp_path, mode, 8.0 + 12.0 / bandwidth_Hz, ROUND, loops=loops | wide, rate_rad_s=0.0)
    assert found.figures["loop_gain"] == pytest.approx(1.0, rel=0.1)
    assert found.figures["phase_margin"] == pytest.approx(margin_deg, rel=0.1)


def test_the_force_along_the_motion_does_not_turn_it(tmp_path: Path) -> None:
    """The loop that follows the pattern has the plant 1/s: damping of the motion has no part in it."""
    loops = {f"{one}_Hz": 2.0 for one in LOOPS} | {"probe": "rate", "probe_Hz": 1.0, "rate_Hz": 1.0}
    found = driven(tmp_path, "classic_whole_angle", 12.0, ROUND, loops=loops, rate_rad_s=0.0)
    assert found.figures["loop_gain"] == pytest.approx(1.0, rel=0.03)
    assert found.figures["phase_margin"] == pytest.approx(60.0, rel=0.03)


def test_loops_that_are_narrow_beside_the_damping_reach_the_amplitude(tmp_path: Path) -> None:
    """At 0.5 Hz the proportional part alone would stop at 0.83 of it, as damping takes 0.63 /s."""
    found = driven(tmp_path, "force_to_rebalance", 4.0, ROUND, loops={f"{one}_Hz": 0.5 for one in LOOPS})
    assert 0.0 < found.figures["ring_up"] < 2.0
    assert found.energy[-1] == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("seed", range(4))
def test_it_starts_from_rest_wherever_the_resonances_are(tmp_path: Path, seed: int) -> None:
    """±1 % of the declared frequency, split up to what half of the drive holds: Δk A/2 of 10 m/s²."""
    random = np.random.default_rng(seed)
    mean = 1579.1367 * (1.0 + random.uniform(-0.02, 0.02))
    half, azimuth = 0.5 * MASS_KG * 10.0 / 1e-4 * random.uniform(-1.0, 1.0), random.uniform(0.0, math.pi)
    cosine, sine = half * math.cos(2.0 * azimuth), half * math.sin(2.0 * azimuth)
    truth = {"stiffness_N_per_m": [mean + cosine, mean - cosine, sine]}
    found = driven(tmp_path, "force_to_rebalance", 4.5, ROUND, truth=truth)
    phases = ("search", "ring_up", "lock", "null")
    assert all(0.0 < found.figures[phase] < (found.limits[phase] or 0.0) for phase in phases)
    resonance = math.sqrt((mean + cosine) / MASS_KG) / math.tau
    assert found.figures["frequency_scored_mean"] == pytest.approx(resonance, rel=1e-5)
    assert found.figures["amplitude_of_set_scored_mean"] == pytest.approx(1.0, abs=1e-3)
    assert max(found.figures[f"{one}_scored_rms"] for one in ("phase_error", "across_over_along")) < 0.01
    assert np.mean(found.energy[-2000:]) == pytest.approx(1.0, abs=2e-3)
    assert np.mean(found.rate[-2000:]) == pytest.approx(RATE_RAD_S, abs=0.01)


@pytest.mark.parametrize(
    ("loops", "truth", "words"),
    [
        ({"ring_up_s": 0.01}, {}, "ring_up took longer than its limit of 0.01 s: the amplitude reached"),
        ({"null_s": 1e-3}, {}, "null took longer than its limit of 0.001 s: motion across the drive is"),
        (
            {},
            {"damping_N_s_per_m": [10.0, 10.0, 0.0]},
            "search took longer than its limit of 4.95 s: no resonance within",
        ),
    ],
)
def test_a_phase_past_its_limit_is_told_in_one_line(
    tmp_path: Path, loops: Mapping[str, Any], truth: Mapping[str, Any], words: str
) -> None:
    with pytest.raises(PluginError, match=words) as raised:
        driven(tmp_path, "force_to_rebalance", 8.0, SPLIT, loops=loops, truth=truth)
    assert str(raised.value).startswith("[controller] mode: ")


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_a_phase_past_its_limit_ends_a_run_in_SAFE(tmp_path: Path) -> None:
    loops = {"ring_up_s": 0.01}
    run = ran(tmp_path, override(bench(), {"controller": {"mode": "force_to_rebalance", "loops": loops}}, "test"))
    assert run.result is not None
    assert run.result.verdict == "interrupted"
    assert "ring_up took longer than its limit" in run.result.reasons[0]
    assert run.result.parts["safety"].reason == "SAFE was confirmed"


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_a_run_tells_the_phases_with_their_limits_and_figures(tmp_path: Path) -> None:
    changes = {"controller": {"mode": "force_to_rebalance"}, "loop": {"duration_s": 3.0}}
    run = ran(tmp_path, override(bench(), changes, "test"))
    result = run.result
    assert result is not None
    assert result.parts["safety"].outcome == "good"
    told = {one.name: one for one in result.algorithm}
    assert list(told)[:4] == ["search", "ring_up", "lock", "null"]
    assert all(0.0 < (told[name].value or 0.0) < (told[name].limit or 0.0) for name in list(told)[:4])


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_a_run_by_the_loops_is_told_by_what_they_do(tmp_path: Path) -> None:
    """Constants that nothing estimates are declared, and in no figure; the pattern is held on purpose, so its angle is
    no error; a comparison has the loops as they ran."""
    changes = {"controller": {"mode": "force_to_rebalance"}, "loop": {"duration_s": 4.0, "settle_s": 3.0}}
    run = ran(tmp_path, override(bench(), changes, "test"))
    scored = score(run.path, tmp_path / "truth.arrow")
    constants = {"kxx", "kyy", "kxy", "dxx", "dyy", "dxy"}
    assert {name for name, one in scored.parameters.items() if one.declared} == constants
    page = render(RunFolder(run.path))
    assert page.count("(declared)") == len(constants)
    assert "control imperfection" not in page
    assert "as the plug-in gives it" not in page
    left = {row.source: row.contribution_rad / (row.declared_rad or 1.0) for row in scored.uncertainty}
    assert left.pop("estimation") == 1.0
    assert max(left.values()) < 3.0, left  # a record adds nothing to what is declared, but by chance: three deviations
    found = compare(
        run.path / "capture.arrow", override(bench(), {"loop": changes["loop"]}, "test"), tmp_path / "compared",
        truth=tmp_path / "truth.arrow", report=False, progress=lambda _: None,
    )  # fmt: skip
    row = found.methods.of("force to rebalance, as run")
    assert row.angle_error_rms_rad == pytest.approx(scored.angle_error_rms_rad, rel=1e-9)
    assert row.angle_expanded_rad == scored.angle_expanded_rad


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"observer": {"plugin": "mine.so"}}, r"\[observer\] plugin: \[controller\] mode"),
        ({"controller": {"loops": {"exchange_s": 0.1}, "mode": "mode_reversal"}}, "exchange_s: shorter than"),
        ({"controller": {"loops": {"rate_Hz": 40.0}}}, "no filter gives these bandwidths"),
        ({"loop": {"mode": "gain", "block": 40}, "link": {"watchdog_s": None}}, r"\[controller\] mode"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(tmp_path: Path, changes: Mapping[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        drive_directly(
            override(declared("force_to_rebalance"), changes, "test"), gyro.scenario(tmp_path / "b.toml"), 0.1
        )


def test_the_mode_of_before_has_no_plug_in_left() -> None:
    back = override(declared("mode_reversal"), {"controller": {"mode": "whole_angle"}}, "test")
    assert (back.observer.plugin, back.controller.plugin) == (None, None)


@pytest.mark.usefixtures("no_report", "no_scan")
@pytest.mark.parametrize("mode", ["force_to_rebalance", "mode_reversal", "classic_whole_angle"])
def test_a_start_that_exceeds_the_limit_of_the_innovation_names_the_cure(tmp_path: Path, mode: str) -> None:
    """From rest to 1000 times the noise: [limits] residual_safe = 100 stops it on the way."""
    changes: dict[str, Any] = {"controller": {"mode": mode}, "limits": {"residual_safe": 100.0}}
    result = ran(tmp_path, override(bench(), changes, "test")).result
    assert result is not None
    assert result.verdict == "interrupted"
    assert "residual_safe = 100 × the noise; the largest was " in result.reasons[0]
    told = "set [limits] residual_safe = "
    assert result.next is not None
    assert result.next.startswith(told)
    assert result.reasons[0].endswith(result.next)
    cured = override(bench(), changes | {"limits": {"residual_safe": float(result.next.removeprefix(told))}}, "test")
    assert not (ran(tmp_path / "cured", cured).result or result).counters["residual_safe"]


@pytest.mark.usefixtures("no_report", "no_scan")
def test_a_plug_in_that_converges_too_late_is_told_of_acquisition_s(tmp_path: Path) -> None:
    changes = {"limits": {"residual_safe": 1e-3}}
    result = ran(tmp_path, override(bench(observer=OWN), changes, "test")).result
    assert result is not None
    assert result.next is not None
    assert result.next.startswith("if the plug-in needs longer to find the motion, set [observer] acquisition_s")
