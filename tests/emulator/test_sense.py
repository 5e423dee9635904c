"""The sense chain: gain and offset from physical constants, filters, delay, noise, converter."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import welch

from device_emulator.scenario import Scenario, load
from device_emulator.section import ScenarioError
from device_emulator.sense import sense_gain
from hil.toml.reading import toml_value
from tests.emulator.gyro import AMPLITUDE_M, EXAMPLES, IDEAL, OMEGA, QUIET, document, record, scenario, undriven, volts

TS = 1.0 / 4000.0
GAIN = -885.41878128  # -(2 · 5 V / 10 pF) · 100 · 8.8541878128 pF/m · 1
LSB = 0.5 / 2**24


def still(**sense: Any) -> Any:
    """A mass at rest: what is left is Φ and noise."""
    return scenario({"truth": {"position_m": [0.0, 0.0]}, "sense": sense})


@pytest.mark.parametrize(
    ("name", "gain"),
    [("s-slow", -885.4), ("s-classic", -8.854e4), ("s-modern", -8.854e4), ("s-undeclared", -885.4)],
)
def test_gain_of_the_examples(name: str, gain: float) -> None:
    assert sense_gain(load(EXAMPLES / f"{name}.scenario.toml")) == pytest.approx((gain, gain), rel=1e-4)


def test_gain_is_negative_and_per_axis() -> None:
    what = scenario({"sense": {"fingers": [100, 50], "gap_m": [2e-6, 4e-6], "feedback_F": [1e-11, 2e-11]}})
    assert sense_gain(what) == pytest.approx((GAIN, GAIN / 8.0), rel=1e-12)


@pytest.mark.moderate
def test_codes_are_the_displacement_to_half_a_step() -> None:
    what = scenario({"truth": {"position_m": [AMPLITUDE_M, 0.5 * AMPLITUDE_M]}})
    codes, truth, _ = record(what, undriven(200))
    for axis, name in enumerate(("x_m", "y_m")):
        assert np.abs(volts(what, codes)[:, axis] - GAIN * truth[name]).max() <= 0.5000001 * LSB


def test_offset_from_mismatch_and_op_amp() -> None:
    """(4): g d + (Co1 + Co2 + Cp + Cf) Vos / Cf."""
    what = still(mismatch_m=[1e-5, -2e-5], opamp_offset_V=[1e-3, -2e-3], overlap_m=2e-4, parasitic_F=5e-12, adc_bits=24)
    codes, truth, _ = record(what, undriven(3))
    rest = 100 * 8.8541878128e-12 * 2e-4
    ratio = (2 * rest + 5e-12 + 1e-11) / 1e-11
    for axis, (d, vos) in enumerate(((1e-5, 1e-3), (-2e-5, -2e-3))):
        expected = GAIN * d + ratio * vos
        np.testing.assert_allclose(truth["phi_x_V" if axis == 0 else "phi_y_V"], expected, rtol=1e-12)
        np.testing.assert_allclose(volts(what, codes)[:, axis], expected, rtol=0, atol=LSB)


def test_feedback_resistor_lets_mismatch_decay_and_keeps_op_amp_offset() -> None:
    resistor, tau = 1e10, 0.1
    what = still(feedback_ohm=resistor, mismatch_m=1e-5, opamp_offset_V=1e-3, parasitic_F=5e-12)
    truth = record(what, undriven(6000)).truth
    t = np.arange(6000) * TS
    at_once = GAIN * 1e-5 + 1e-3 * (2 * 100 * 8.8541878128e-12 * 2e-4 + 5e-12) / 1e-11
    np.testing.assert_allclose(truth["phi_x_V"], 1e-3 + at_once * np.exp(-t / tau), rtol=0, atol=1e-12)


def test_drift_is_linear() -> None:
    truth = record(still(drift_V_per_s=[1e-3, -2e-3]), undriven(4001)).truth
    np.testing.assert_allclose(truth["phi_x_V"][[0, 2000, 4000]], [0.0, 5e-4, 1e-3], atol=1e-15)
    np.testing.assert_allclose(truth["phi_y_V"][[0, 2000, 4000]], [0.0, -1e-3, -2e-3], atol=1e-15)


@pytest.mark.parametrize("corner_Hz", [20.0, 200.0, 1500.0, 1e5])
def test_low_pass(corner_Hz: float) -> None:
    """ẇ = a (x - w) from w(0) = x(0), x = A cos ωt, solved by hand."""
    what = scenario(IDEAL, {"sense": {"low_pass_Hz": corner_Hz}})
    codes = record(what, undriven(400)).codes
    t, a = np.arange(400) * TS, 2 * np.pi * corner_Hz
    response = a / (a + 1j * OMEGA)
    smooth = (response * np.exp(1j * OMEGA * t)).real + (1.0 - response.real) * np.exp(-a * t)
    np.testing.assert_allclose(
        volts(what, codes)[:, 0],
        GAIN * AMPLITUDE_M * smooth,
        rtol=0,
        atol=LSB + 1e-7 * AMPLITUDE_M * abs(GAIN),
    )


def test_high_pass_of_the_feedback_resistor() -> None:
    """q = x - u, u̇ = (x - u) / RC from u(0) = 0."""
    what = scenario(IDEAL, {"sense": {"feedback_ohm": 1e8}})  # RC = 1 ms, ω RC = 1.26
    codes = record(what, undriven(400)).codes
    t, a = np.arange(400) * TS, 1e3
    response = a / (a + 1j * OMEGA)
    leaked = (response * np.exp(1j * OMEGA * t)).real - response.real * np.exp(-a * t)
    np.testing.assert_allclose(
        volts(what, codes)[:, 0],
        GAIN * AMPLITUDE_M * (np.cos(OMEGA * t) - leaked),
        rtol=0,
        atol=LSB + 1e-7 * AMPLITUDE_M * abs(GAIN),
    )


def delayed_by(tau_x: float, tau_y: float) -> dict[str, Any]:
    return {"effect": [{"name": "sense_delay", "tsx": tau_x, "tsy": tau_y}]}


@pytest.mark.parametrize("samples", [0.0, 0.01, 0.37, 1.0, 5.5, 30.0])
def test_sense_delay_is_exact_from_the_first_row(samples: float) -> None:
    tau = samples * TS
    where = {"truth": {"position_m": [AMPLITUDE_M, AMPLITUDE_M]}}
    what = scenario(IDEAL, where, delayed_by(tau, 0.5 * tau))
    codes = record(what, undriven(200)).codes
    t = np.arange(200) * TS
    for axis, lag in enumerate((tau, 0.5 * tau)):
        expected = GAIN * AMPLITUDE_M * np.cos(OMEGA * (t - lag))
        np.testing.assert_allclose(volts(what, codes)[:, axis], expected, rtol=0, atol=LSB)


@pytest.mark.parametrize(
    ("effect", "shown"),
    [
        ({"name": "sense_gain", "gx": 0.02, "gy": -0.03}, lambda x, y: (1.02 * x, 0.97 * y)),
        (
            {"name": "sense_cross_coupling", "ex": 0.05, "ey": -0.04},
            lambda x, y: (x + 0.05 * y, y - 0.04 * x),
        ),
        (
            {"name": "sense_quadratic", "a2x": 300.0, "a2y": -200.0},
            lambda x, y: (x + 300 * x**2, y - 200 * y**2),
        ),
        ({"name": "sense_cubic", "a3x": 3e6, "a3y": 2e6}, lambda x, y: (x + 3e6 * x**3, y + 2e6 * y**3)),
    ],
    ids=lambda v: v["name"] if isinstance(v, dict) else "",
)
@pytest.mark.parametrize("low_pass_Hz", [np.inf, 1e6])
def test_what_the_combs_read(effect: dict[str, Any], shown: Any, low_pass_Hz: float) -> None:
    """Straight, and through the filters: a corner far away delays by 0.16 µs and changes nothing else."""
    where = {"truth": {"position_m": [AMPLITUDE_M, 0.7 * AMPLITUDE_M]}, "sense": {"low_pass_Hz": low_pass_Hz}}
    what = scenario(where, {"effect": [effect]})
    codes, truth, _ = record(what, undriven(300))
    expected = GAIN * np.column_stack(shown(truth["x_m"], truth["y_m"]))
    tolerance = LSB if np.isinf(low_pass_Hz) else 3e-4 * abs(GAIN) * AMPLITUDE_M
    np.testing.assert_allclose(volts(what, codes), expected, rtol=0, atol=tolerance)


def test_drive_feedthrough_shows_the_drive_of_the_same_row() -> None:
    what = scenario(
        {
            "truth": {"position_m": [0, 0]},
            "effect": [{"name": "drive_feedthrough", "gamma_x": 1e-3, "gamma_y": -2e-3}],
        }
    )
    drive = np.random.default_rng(3).integers(-3000, 3000, (50, 2))
    drive[0] = 0
    codes, truth, _ = record(what, drive)
    moved = GAIN * np.column_stack([truth["x_m"], truth["y_m"]])
    expected = moved + drive * (10.0 / 32768) * [1e-3, -2e-3]
    np.testing.assert_allclose(volts(what, codes), expected, rtol=0, atol=LSB)


def test_interference() -> None:
    line = {
        "name": "interference",
        "ax": 0.01,
        "ay": 0.02,
        "frequency": 50.0,
        "phase_x": 0.3,
        "phase_y": -1.0,
    }
    what = scenario({"truth": {"position_m": [0, 0]}, "effect": [line]})
    codes = record(what, undriven(200)).codes
    phase = 2 * np.pi * 50.0 * np.arange(200) * TS
    expected = np.column_stack([0.01 * np.sin(phase + 0.3), 0.02 * np.sin(phase - 1.0)])
    np.testing.assert_allclose(volts(what, codes), expected, rtol=0, atol=LSB)


def test_a_mode_that_rings_is_a_phasor_that_dies_away() -> None:
    begins = {"cmx": 0.01, "smx": 0.004, "cmy": 0.0, "smy": -0.02}
    mode = {"name": "free_mode", "wm": 2 * np.pi * 310.0, "dm": 40.0, **begins}
    what = scenario({"truth": {"position_m": [0, 0]}, "effect": [mode]})
    codes = record(what, undriven(200)).codes
    turned = np.exp((2j * np.pi * 310.0 - 20.0) * np.arange(200) * TS)
    expected = np.column_stack([((0.01 - 0.004j) * turned).real, (0.02j * turned).real])
    np.testing.assert_allclose(volts(what, codes), expected, rtol=0, atol=2 * LSB)
    assert np.max(np.abs(expected)) > 1000 * LSB


def test_quantisation_and_clipping() -> None:
    what = scenario(IDEAL, {"sense": {"adc_bits": 8, "adc_full_scale_V": 0.05}})
    codes, truth, device = record(what, undriven(40))
    step = 0.1 / 256
    exact = GAIN * truth["x_m"] / step
    np.testing.assert_array_equal(codes[:, 0], np.clip(np.rint(exact), -128, 127))
    assert {-128, 127} <= set(codes[:, 0].tolist())
    assert device.clipped
    small = record(scenario(IDEAL, {"truth": {"position_m": [1e-5, 0.0]}}), undriven(40))
    assert not small.device.clipped


@pytest.mark.moderate
def test_white_noise_has_its_size_and_no_colour() -> None:
    what = still(noise_V=1e-3)
    shown = volts(what, record(what, undriven(40_000)).codes)
    correlation = np.corrcoef(np.vstack([shown.T, np.roll(shown, 1, axis=0).T]))
    assert np.std(shown, axis=0) == pytest.approx([1e-3, 1e-3], rel=5 / np.sqrt(2 * 40_000))
    assert np.abs(correlation - np.eye(4)).max() < 5 / np.sqrt(40_000)


@pytest.mark.moderate
def test_random_walk_has_its_density() -> None:
    truth = record(still(random_walk_V_per_rts=1e-3), undriven(40_000)).truth
    for name in ("phi_x_V", "phi_y_V"):
        assert truth[name][0] == 0.0
        assert np.std(np.diff(truth[name])) == pytest.approx(1e-3 * np.sqrt(TS), rel=5 / np.sqrt(2 * 40_000))


@pytest.mark.slow
def test_flicker_noise_falls_as_one_over_f() -> None:
    """One-sided density F²/f over two decades, in bands of a third of a decade."""
    density = 1e-4
    truth = record(still(flicker_V_at_1Hz=density), undriven(400_000)).truth
    frequency, power = welch(truth["phi_x_V"], fs=4000.0, nperseg=8000, detrend="constant")
    for low in 10 ** np.arange(0.4, 2.6, 1 / 3):
        band = (frequency >= low) & (frequency < 2.15 * low)
        averaged = 2 * 50 * band.sum()  # degrees of freedom, of which overlapping windows share some
        assert np.mean(power[band] * frequency[band]) == pytest.approx(
            density**2, rel=0.065 + 5 * np.sqrt(2.0 / averaged)
        )


PIEZO = {
    "kind": "piezo", "charge_C_per_m": [7e-7, 3e-7], "feedback_ohm": 1e6, "noise_V": 0.0, "adc_bits": 24,
    "adc_full_scale_V": 0.25,
}  # fmt: skip


def piezo(**sense: Any) -> Scenario:
    """The quiet S-slow on round springs without loss, read by piezoelectric layers."""
    return Scenario.model_validate(document(QUIET, IDEAL) | {"sense": PIEZO | sense})


def test_a_layer_shows_the_velocity() -> None:
    """-Rf η ẋ to half a code, each axis by its own layer, under a drive that steps."""
    what = piezo()
    assert sense_gain(what) == pytest.approx((-0.7, -0.3), rel=1e-12)
    drives = np.random.default_rng(1).integers(-20000, 20000, (300, 2))
    codes, truth, _ = record(what, drives)
    shown = volts(what, codes)
    for axis, (name, gain) in enumerate((("vx_mps", -0.7), ("vy_mps", -0.3))):
        assert np.abs(shown[:, axis] - gain * truth[name]).max() <= 0.5000001 * LSB


@pytest.mark.parametrize("corner_Hz", [150.0, 2e3, 1e5])
def test_above_its_corner_a_current_amplifier_shows_the_displacement(corner_Hz: float) -> None:
    """Vo + Rf Cf V̇o = -Rf η ẋ of x = A cos ωt, from the first sample on: the board has been on before."""
    what = piezo(feedback_F=1.0 / (2.0 * np.pi * corner_Hz * 1e6))
    codes = record(what, undriven(800)).codes
    t, tau = np.arange(800) * TS, 1.0 / (2.0 * np.pi * corner_Hz)
    response = 1j * OMEGA / (1.0 + 1j * OMEGA * tau)
    due = -0.7 * AMPLITUDE_M * (response * np.exp(1j * OMEGA * t)).real
    np.testing.assert_allclose(volts(what, codes)[:, 0], due, rtol=0, atol=LSB + 1e-8)


def test_offset_of_a_layer_from_op_amp_and_bias_current() -> None:
    """(1 + Rf/Rs) Vos + Rf Ib, as the truth has it and the mass at rest shows it."""
    what = piezo(source_ohm=[1e7, 5e6], opamp_offset_V=[1e-3, -2e-3], bias_A=[2e-9, 1e-9])
    what = what.model_copy(update={"truth": what.truth.model_copy(update={"position_m": (0.0, 0.0)})})
    codes, truth, _ = record(what, undriven(3))
    for axis, due in enumerate((1.1e-3 + 2e-3, -2e-3 * 1.2 + 1e-3)):
        np.testing.assert_allclose(truth[("phi_x_V", "phi_y_V")[axis]], due, rtol=1e-12)
        np.testing.assert_allclose(volts(what, codes)[:, axis], due, rtol=0, atol=LSB)


def test_a_delay_behind_a_layer_is_one_of_the_velocity() -> None:
    what = Scenario.model_validate(document(QUIET, IDEAL, delayed_by(1.3 * TS, 0.0)) | {"sense": PIEZO})
    t = np.arange(200) * TS - 1.3 * TS
    due = 0.7 * AMPLITUDE_M * OMEGA * np.sin(OMEGA * t)
    np.testing.assert_allclose(volts(what, record(what, undriven(200)).codes)[:, 0], due, rtol=0, atol=LSB + 1e-8)


@pytest.mark.parametrize(
    ("sense", "told"),
    [
        ({"kind": "camera"}, r"\[sense\] kind: unknown kind 'camera'"),
        (PIEZO | {"fingers": 100}, r"\[sense\] fingers: unknown key"),
        ({k: v for k, v in PIEZO.items() if k != "feedback_ohm"}, r"\[sense\] feedback_ohm: missing"),
    ],
)
def test_a_chain_that_is_none_is_one_line(tmp_path: Path, sense: dict[str, Any], told: str) -> None:
    table = document() | {"sense": sense}
    file = tmp_path / "board.toml"
    lines = [f"seed = {table.pop('seed')}"]
    for section, keys in (table | {"rate": {"kind": "constant", "rate_rad_s": 0.0}}).items():
        lines += [f"[{section}]", *(f"{key} = {toml_value(value)}" for key, value in keys.items())]
    file.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ScenarioError, match=told):
        load(file)
