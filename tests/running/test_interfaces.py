"""Sense interfaces by name: each on two axes, run and traced; the host's map beside the board's own."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import hil
from device_emulator.device import Device
from device_emulator.scenario import Scenario
from device_emulator.sense import sense_gain
from estimator.declared_loop import DeclaredLoop
from estimator.interface import MAPS, Interface
from estimator.observer import Observer
from hil.bench import Bench, examples, load_bench, override
from hil.errors import InputError
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.library.generating import assumed_board
from hil.running.closing_scan import scan_run
from hil.toml.reading import toml_value
from hil.tracing.request import request_of
from hil.tracing.trace import trace
from hil.verdict.budget import budget
from tests.running.closed import angle_errors, close_loop, waiting
from tests.running.test_force_loop import innovation_ratio

A, OMEGA = 1e-4, 2.0 * math.pi * 200.0
BEHIND = {"adc_bits": 16, "adc_full_scale_V": 0.25, "noise_V": 8.9e-5}
PIXELS = {"adc_bits": 16, "adc_full_scale_V": 512.0, "noise_V": 0.1, "offset_V": [3.0, -2.0]}
SHOT_V = 1.77e8 * math.sqrt(2.0 * 1.602e-19 * 1e-9 * 2000.0)
# Of each: [sense] of the board; [device.sense] of the bench, its interface.
BOARDS: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "comb": (
        {
            "fingers": 100, "width_m": 2e-6, "gap_m": 2e-6, "overlap_m": 2e-4, "bias_V": 5.0, "feedback_F": 1e-11,
            "mismatch_m": [1e-5, -8e-6], **BEHIND,
        },
        {},
        {},
    ),
    "gap_closing": (
        {
            "kind": "gap_closing", "area_m2": 6.25e-6, "gap_m": [2.5e-4, 3e-4], "bias_V": 5.0, "feedback_F": 1e-11,
            "offset_V": [9e-3, -7e-3], **BEHIND,
        },
        {"gain_V_per_m": (-885.42, -614.87)},
        {"gap_m": (2.5e-4, 3e-4)},
    ),
    "optical": (
        {"kind": "optical", "magnification": 5.0, "pixel_m": 5e-6, "distortion_per_m2": 5e6, **PIXELS},
        {"gain_V_per_m": (1e6,), "noise_V": 0.1, "offset_sd_V": 5.0, "unit": "px"},
        {"distortion_per_m2": (5e6,)},
    ),
    "piezoresistive": (
        {
            "kind": "piezoresistive", "supply_V": 5.0, "gauge_factor": 100.0, "strain_per_m": 1.77,
            "temperature_per_K": -2e-3, "offset_V": [9e-3, -7e-3], **BEHIND,
        },
        {"gain_V_per_m": (-885.0,)},
        {"temperature_per_K": (-2e-3,)},
    ),
    "piezoelectric": (
        {"kind": "piezo", "charge_C_per_m": 7e-7, "feedback_ohm": 1e6, "feedback_F": 5e-11, **BEHIND},
        {"senses": "velocity", "gain_V_per_m": (-0.7,), "offset_sd_V": 0.003},
        {"corner_Hz": (1.0 / (2.0 * math.pi * 1e6 * 5e-11),)},
    ),
    "tunnelling": (
        {
            "kind": "tunnelling", "current_A": 1e-9, "decay_per_m": [5e3, 4e3], "feedback_ohm": 1.77e8,
            "offset_V": [9e-3, -7e-3], **BEHIND,
        },
        {"gain_V_per_m": (-885.0, -708.0), "noise_V": math.hypot(8.9e-5, SHOT_V)},
        {"decay_per_m": (5e3, 4e3)},
    ),
}  # fmt: skip


def bench(kind: str, duration_s: float = 4.0, *, declared: bool = True) -> Bench:
    """S-slow's with that interface, its constant known to 1 %; without `declared` taken for a comb of the same gain."""
    _, sense, keys = BOARDS[kind]
    interface = {"kind": kind, **keys, **({"constant_u": 0.01} if keys else {})} if declared else {"kind": "comb"}
    loop = {"duration_s": duration_s, "settle_s": 0.4 * duration_s, "clock": "lockstep", "seed": 7}
    changes = {"loop": loop, "device": {"sense": {**sense, "interface": interface}}}
    return override(load_bench(examples.find("bench", "s-slow")), changes, "test")


def table(kind: str) -> dict[str, Any]:
    """S-slow's scenario with that readout at a constant rate of 1 rad/s."""
    known: dict[str, Any] = tomllib.loads(examples.find("scenario", "s-slow").read_text(encoding="utf-8"))
    return known | {"sense": BOARDS[kind][0], "rate": {"kind": "constant", "rate_rad_s": 1.0}}


def scenario(path: Path, kind: str) -> Path:
    known = table(kind)
    lines = [f"seed = {known.pop('seed')}"]
    for section, keys in known.items():
        lines += [f"[{section}]", *(f"{key} = {toml_value(value)}" for key, value in keys.items())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["force", "gain"])
@pytest.mark.parametrize("kind", BOARDS)
def test_each_interface_closes_the_loop_and_its_map_is_in_the_budget(tmp_path: Path, kind: str, mode: str) -> None:
    blocks = {"block": 20, "estimate_every": 20} if mode == "gain" else {}
    truth, declared = tmp_path / "truth.arrow", override(bench(kind), {"loop": {"mode": mode, **blocks}}, "test")
    run, _ = close_loop(waiting(scenario(tmp_path / "board.toml", kind), truth), declared, tmp_path / "run")
    assert innovation_ratio(run) == pytest.approx(1.0, abs=0.05)
    found = scan_run(run, declared, lambda _: None)
    assert found is not None
    told = budget(run.estimates, declared, found.information)
    assert np.abs(angle_errors(run, truth, 1.6)).max() < 5e-3
    assert told.angle_expanded_rad is not None
    assert np.abs(angle_errors(run, truth, 1.6)[-1]) < 1.5 * told.angle_expanded_rad
    rows = {row.source: row for row in told.uncertainty}
    assert ("sense interface" in rows) == (kind != "comb")
    if kind != "comb":
        assert rows["sense interface"].value == declared.device.known["sense_interface"].u > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*BOARDS, "velocity"])
def test_the_declared_device_shows_what_its_interface_shows(kind: str) -> None:
    """In the loop in which golden vectors are made and plug-ins tried: the observer finds its noise and its rate."""
    velocity: dict[str, Any] = {"senses": "velocity", "gain_V_per_m": (-0.7,), "offset_sd_V": 0.003}
    declared = override(bench("comb"), {"device": {"sense": velocity}}, "test") if kind == "velocity" else bench(kind)
    identity = assumed_board(declared, 1, None, None)
    settings = board_device_of(declared), observer_settings_of(declared), controller_settings_of(declared, identity)
    observer, loop = Observer(*settings), DeclaredLoop(Observer(*settings))
    found = []
    for sample in range(8000):
        sensed, applied = loop.sample()
        observer.enable_control(sample >= 200)
        loop.answer(observer.tick(*map(float, sensed), *map(float, applied)))
        row = observer.newest
        found.append((float(row["angle"]), float(row["energy_ratio"]), *(row["nu"] / np.sqrt(row["s"]))))
    angle, energy, *ratios = np.array(found[4000:]).T
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.05)
    assert np.mean(energy) == pytest.approx(1.0, abs=0.01)
    assert (angle[-1] - angle[0]) * 4000.0 / (len(angle) - 1) == pytest.approx(1.0, abs=0.02)


@pytest.mark.usefixtures("no_sizes")
def test_a_boards_own_estimator_has_every_map_but_that_over_temperature(tmp_path: Path) -> None:
    for kind in BOARDS:
        if kind != "piezoresistive":
            hil.generate(bench(kind), out=tmp_path / kind)
            continue
        with pytest.raises(InputError, match=r"\[device.sense.interface\] depends on the temperature, which a board's"):
            hil.generate(bench(kind), out=tmp_path / kind)
        with pytest.raises(InputError, match=r'"piezoresistive" needs the temperature.* mode = "gain" or "force"'):
            override(bench(kind), {"loop": {"mode": "board", "block": 20, "estimate_every": 20}}, "test")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gap_closing", "optical", "tunnelling", "piezoelectric"])
def test_a_map_that_is_not_declared_is_missed(tmp_path: Path, kind: str) -> None:
    run, _ = close_loop(waiting(scenario(tmp_path / "b.toml", kind)), bench(kind, 2.0, declared=False), tmp_path / "r")
    assert not innovation_ratio(run) < 1.5


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", BOARDS)
def test_a_trace_finds_nothing_where_the_map_is_declared(tmp_path: Path, kind: str) -> None:
    declared = bench(kind)
    run, _ = close_loop(waiting(scenario(tmp_path / "board.toml", kind)), declared, tmp_path / "run")
    request = request_of(run.capture_path, declared, {"report": False})
    found = trace(request, tmp_path / "traced", progress=lambda _: None).diagnosis
    assert found.verdict == "adequate", found.reasons


@pytest.mark.parametrize("kind", [kind for kind in BOARDS if kind != "piezoelectric"])
def test_the_map_is_that_of_the_board(kind: str) -> None:
    """Codes of an undriven board without noise that swings along x, beside the host's map at its true motion."""
    known = table(kind)
    known["sense"] = known["sense"] | {"noise_V": 0.0, "adc_bits": 24}
    for key in ("offset_V", "mismatch_m"):
        known["sense"].pop(key, None)
    if kind == "tunnelling":  # its shot noise is that of the current: more of it, and less resistance
        known["sense"] |= {"current_A": 1e3, "feedback_ohm": 1.77e-4}
    known["truth"] |= {"stiffness_N_per_m": [1600.0, 1600.0, 0.0], "damping_N_s_per_m": [0.0, 0.0, 0.0]}
    known["truth"] |= {"temperature_K": 0.0}
    known |= {"rate": {"kind": "constant", "rate_rad_s": 0.0}, "temperature": {"warm_up_K": 10.0}}
    pages: list[Any] = []
    scenario = Scenario.model_validate(known)
    device = Device(scenario, 1, lambda _, page: pages.append(page.copy()))
    codes = device.rows(np.zeros((200, 2), np.int32))[:, 0]
    device.close()
    x = np.concatenate(pages)[:, 0]
    assert np.ptp(x) > 1.9 * A
    value = (next(iter(BOARDS[kind][2].values())) if kind != "comb" else (0.0,))[0]
    if kind == "piezoresistive":  # by how much it is warmer: a time constant of 1 s, samples at 4 kHz
        shown = x * (1.0 + value * 10.0 * -np.expm1(-np.arange(200) / 4000.0))
    else:
        shown = Interface(kind, (value, value) if value else (), OMEGA).shown(0, x)  # type: ignore[arg-type]
    gain = sense_gain(scenario)[0]
    full_V = BOARDS[kind][0]["adc_full_scale_V"]
    np.testing.assert_allclose(codes * full_V / 2**23, gain * shown, atol=1e-6 * abs(gain) * A)
    declared = bench(kind).device.sense_gains_V_per_m[0]
    assert gain == pytest.approx(declared, rel=1e-3)


def test_strain_gauges_follow_a_recorded_temperature() -> None:
    """A ring-down while it gets 20 K warmer: without its temperature the displacement is 3.5 % too small."""
    pages: list[Any] = []
    known = table("piezoresistive") | {"temperature": {"warm_up_K": 20.0, "time_constant_s": 1.0}}
    device = Device(Scenario.model_validate(known), 1, lambda _, page: pages.append(page.copy()))
    volts = device.rows(np.zeros((8000, 2), np.int32)) * 0.25 / 2**15
    device.close()
    temperature = 25.0 + 20.0 * -np.expm1(-np.arange(8000) / 4000.0)
    declared = bench("piezoresistive")
    true = np.concatenate(pages)[6000:, [0, 2]]
    errors = []
    for channel in (temperature, None):
        observer = Observer(board_device_of(declared), observer_settings_of(declared))
        state = observer.run(volts, np.zeros((8000, 2)), temperature=channel).state
        errors.append(np.sqrt(np.mean((state[6000:, [0, 2]] - true) ** 2) / np.mean(true**2)))
    assert errors[0] < 1.5e-3
    assert errors[1] == pytest.approx(2e-3 * 20.0 * (1.0 - math.exp(-1.75)), rel=0.1)


@pytest.mark.parametrize("kind", MAPS)
def test_a_map_its_derivative_and_its_inverse_agree(kind: str) -> None:
    value = next(iter(BOARDS[kind][2].values()))[0]
    c = 2.0 * math.pi * value if kind == "piezoelectric" else value
    one = Interface(kind, (c, c), OMEGA)  # type: ignore[arg-type]
    x = np.linspace(-A, A, 2001)
    shown = one.shown(0, x)
    np.testing.assert_allclose(one.inverse(0, shown), x, atol=1e-12 * A)
    np.testing.assert_allclose(one.slope(0, x[1:-1]), np.gradient(shown, x)[1:-1], rtol=1e-5)
    root = brentq(lambda at: float(one.shown(0, np.array(at))) - shown[1500], -A, A, xtol=1e-18)
    assert root == pytest.approx(x[1500], rel=1e-9)


def test_the_amplitude_error_of_a_gap_is_that_of_the_series() -> None:
    """x/(1 - (x/Z)²) to third order: the error 2 δZ/Z x³/Z², of which ¾ A² is in phase; exactly by quad."""
    gap = 10.0 * A
    one = Interface("gap_closing", (gap, gap), OMEGA)
    assert one.amplitude_error(A, 0.01, 0.0) == pytest.approx(0.01 * 2.0 * 0.75 * (A / gap) ** 2, rel=0.02)
    near = Interface("gap_closing", (2.0 * A, 2.0 * A), OMEGA)

    def error(phase: float) -> float:
        q = (0.5 * math.cos(phase)) ** 2
        return 2.0 * q / (1.0 + q) * math.cos(phase) ** 2 * 0.01

    exact = quad(error, 0.0, 2.0 * math.pi)[0] / math.pi
    assert near.amplitude_error(A, 0.01, 0.0) == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize(
    ("interface", "told"),
    [
        ({"kind": "gap_closing"}, "gap_m: missing"),
        ({"kind": "gap_closing", "gap_m": (5e-5,)}, "within the amplitude"),
        ({"kind": "gap_closing", "gap_m": (3e-4, 3e-4, 3e-4)}, "expected one number or 2"),
        ({"kind": "optical", "gap_m": (3e-4,)}, 'gap_m: belongs to kind = "gap_closing"'),
        ({"kind": "optical", "distortion_per_m2": (-1e9,)}, "folds the image"),
        ({"kind": "piezoelectric", "corner_Hz": (800.0,)}, "senses a velocity"),
        ({"kind": "tunnelling", "decay_per_m": (1e10,)}, "the unit is 1/m"),
        ({"kind": "comb", "constant_u": 0.1}, "has no constant"),
        ({"kind": "comb", "temperature_u_K": 0.1}, 'belongs to kind = "piezoresistive"'),
        ({"kind": "microphone"}, "kind"),
    ],
)
def test_what_is_wrong_in_a_declaration_is_one_line(interface: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told) as raised:
        load_bench(examples.find("bench", "s-slow")).with_(device={"sense": {"interface": interface}})
    assert "\n" not in str(raised.value)
