"""The mass against an independent integrator, closed forms and statistical physics."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from device_emulator.scenario import Scenario
from tests.emulator.gyro import AMPLITUDE_M, IDEAL, KB, OMEGA, record, scenario, undriven

TS = 1.0 / 4000.0
SINE = {"kind": "sine", "amplitude_rad_s": 40.0, "frequency_Hz": 25.0, "phase_rad": 0.3, "offset_rad_s": 10.0}


def sine_rate(t: float) -> tuple[float, float]:
    w = 2.0 * np.pi * 25.0
    return 10.0 + 40.0 * np.sin(w * t + 0.3), 40.0 * w * np.cos(w * t + 0.3)


def reference(
    what: Scenario,
    drive: NDArray[np.float64],
    hidden: Any = lambda t, x, vx, y, vy: (0.0, 0.0),
    rate: Any = sine_rate,
    max_step: float = np.inf,
) -> NDArray[np.float64]:
    """Rows of [x, ẋ, y, ẏ], interval by interval, written down from the equation of motion anew."""
    m = what.truth.mass_kg
    (kxx, kyy, kxy), (dxx, dyy, dxy) = what.truth.stiffness_N_per_m, what.truth.damping_N_s_per_m

    def motion(t: float, s: NDArray[np.float64], ux: float, uy: float) -> list[float]:
        x, vx, y, vy = s
        w, dw = rate(t)
        hx, hy = hidden(t, x, vx, y, vy)
        ax = ux + 2 * w * vy + w * w * x + dw * y - (dxx * vx + dxy * vy + kxx * x + kxy * y) / m + hx
        ay = uy - 2 * w * vx + w * w * y - dw * x - (dxy * vx + dyy * vy + kxy * x + kyy * y) / m + hy
        return [vx, ax, vy, ay]

    (x, y), (vx, vy) = what.truth.position_m, what.truth.velocity_mps
    rows = [np.array([x, vx, y, vy])]
    for m_row in range(1, len(drive)):
        solved = solve_ivp(
            motion,
            ((m_row - 1) * TS, m_row * TS),
            rows[-1],
            method="DOP853",
            rtol=1e-11,
            atol=1e-18,
            max_step=max_step,
            args=tuple(drive[m_row]),
        )
        rows.append(solved.y[:, -1])
    return np.array(rows)


def states(truth: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.column_stack([truth[name] for name in ("x_m", "vx_mps", "y_m", "vy_mps")])


def pushes(n: int) -> NDArray[np.int32]:
    """Drive codes that differ in every interval."""
    return np.random.default_rng(7).integers(-32767, 32768, (n, 2)).astype(np.int32)


def assert_same_motion(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> None:
    scale = np.array([1.0, OMEGA, 1.0, OMEGA]) * AMPLITUDE_M
    np.testing.assert_allclose(ours / scale, theirs / scale, rtol=0, atol=2e-10)


@pytest.mark.moderate
def test_every_term_of_the_base_model() -> None:
    what = scenario(
        {
            "truth": {
                "stiffness_N_per_m": [1700.0, 1500.0, 200.0],
                "damping_N_s_per_m": [0.2, 0.1, 0.05],
                "position_m": [AMPLITUDE_M, -3e-5],
                "velocity_mps": [0.02, 0.05],
            },
            "rate": SINE,
        }
    )
    codes = pushes(120)
    assert_same_motion(states(record(what, codes).truth), reference(what, codes * (10.0 / 32768)))


def test_without_hidden_effects_a_shorter_way_to_the_same_bits() -> None:
    """A constant force of nothing makes the device take the long one."""
    noisy = {"truth": {"temperature_K": 300.0}, "drive": {"noise_mps2_per_rtHz": 1e-4}, "rate": SINE}
    nothing = {"effect": [{"name": "constant_force", "ax": 0.0, "ay": 0.0}]}
    short, long = (record(scenario(noisy, *more), pushes(200)) for more in ((), (nothing,)))
    assert np.array_equal(states(short.truth), states(long.truth))
    assert np.array_equal(short.codes, long.codes)


HIDDEN: dict[str, tuple[dict[str, float], Any]] = {
    "cubic_stiffness": (
        {"k3x": 3e13, "k3y": -1e13},
        lambda t, x, vx, y, vy: (-3e13 * x**3, 1e13 * y**3),
    ),
    "cubic_isotropic": (
        {"k3": 2e13},
        lambda t, x, vx, y, vy: (-2e13 * (x * x + y * y) * x, -2e13 * (x * x + y * y) * y),
    ),
    "quintic_stiffness": (
        {"k5x": 3e20, "k5y": -1e20},
        lambda t, x, vx, y, vy: (-3e20 * x**5, 1e20 * y**5),
    ),
    "quintic_isotropic": (
        {"k5r": 2e20},
        lambda t, x, vx, y, vy: (-2e20 * (x * x + y * y) ** 2 * x, -2e20 * (x * x + y * y) ** 2 * y),
    ),
    "quadratic_stiffness": (
        {"k2x": 1e9, "k2y": 2e9},
        lambda t, x, vx, y, vy: (-1e9 * x * x, -2e9 * y * y),
    ),
    "nonlinear_damping": (
        {"d3x": 3e9, "d3y": 1e9},
        lambda t, x, vx, y, vy: (-3e9 * x * x * vx, -1e9 * y * y * vy),
    ),
    "dry_friction": (
        {"fx": 2.0, "fy": 3.0, "v0": 0.1},
        lambda t, x, vx, y, vy: (-2.0 * np.tanh(vx / 0.1), -3.0 * np.tanh(vy / 0.1)),
    ),
    "constant_force": ({"ax": 3.0, "ay": -2.0}, lambda t, x, vx, y, vy: (3.0, -2.0)),
    "base_vibration": (
        {"ax": 2.0, "ay": 3.0, "frequency": 70.0, "phase_x": 0.2, "phase_y": 1.0},
        lambda t, x, vx, y, vy: (
            2.0 * np.sin(2 * np.pi * 70.0 * t + 0.2),
            3.0 * np.sin(2 * np.pi * 70.0 * t + 1.0),
        ),
    ),
}


@pytest.mark.moderate
@pytest.mark.parametrize("name", HIDDEN)
def test_hidden_forces(name: str) -> None:
    coefficients, force = HIDDEN[name]
    what = scenario(
        {
            "truth": {"position_m": [AMPLITUDE_M, 0.6 * AMPLITUDE_M]},
            "rate": SINE,
            "effect": [{"name": name, **coefficients}],
        }
    )
    codes = pushes(60)
    assert_same_motion(states(record(what, codes).truth), reference(what, codes * (10.0 / 32768), force))


@pytest.mark.slow
@pytest.mark.parametrize("rest", [0.003, 0.02])
@pytest.mark.parametrize("name", ["dry_friction", "dry_friction_asymmetric"])
def test_friction_turns_over_within_a_step(name: str, rest: float) -> None:
    """v0 of a share of A ω0: a turn that is narrower than an eighth of a sample, over twenty cycles."""
    v0, one_way = rest * OMEGA * AMPLITUDE_M, {"ax": 0.3, "ay": -0.4} if name == "dry_friction_asymmetric" else {}
    effect = {"name": name, "fx": 0.5, "fy": 0.3, "v0": v0, **one_way}
    what = scenario({"truth": {"position_m": [AMPLITUDE_M, 0.6 * AMPLITUDE_M]}, "rate": SINE, "effect": [effect]})

    def rub(t: float, x: float, vx: float, y: float, vy: float) -> tuple[float, float]:
        tx, ty = np.tanh(vx / v0), np.tanh(vy / v0)
        return -0.5 * (tx + one_way.get("ax", 0.0) * tx**2), -0.3 * (ty + one_way.get("ay", 0.0) * ty**2)

    codes = pushes(60) // 20
    expected = reference(what, codes * (10.0 / 32768), rub, max_step=TS * rest / 0.3)
    scale = np.array([1.0, OMEGA, 1.0, OMEGA]) * AMPLITUDE_M
    got = states(record(what, codes).truth)
    np.testing.assert_allclose(got / scale, expected / scale, rtol=0, atol=2e-9)


@pytest.mark.moderate
def test_drive_gain_and_misalignment() -> None:
    effects = [
        {"name": "drive_gain", "hx": 0.1, "hy": -0.2},
        {"name": "drive_misalignment", "mx": 0.05, "my": -0.03},
    ]
    what = scenario({"rate": SINE, "effect": effects})
    codes = pushes(60)
    u = codes * (10.0 / 32768) * [1.1, 0.8]
    reached = u + u[:, ::-1] * [0.05, -0.03]
    assert_same_motion(states(record(what, codes).truth), reference(what, reached))


@pytest.mark.parametrize(("tau_x", "tau_y"), [(0.3, 0.0), (1.6, 0.25), (3.0, 2.0)])
def test_drive_delay_is_exact_between_samples(tau_x: float, tau_y: float) -> None:
    """Against a device sampled 20 times faster, to which the delay is a whole number of samples."""
    delay = {"name": "drive_delay", "tux": tau_x * TS, "tuy": tau_y * TS}
    codes = pushes(40)
    slow = record(scenario({"effect": [delay]}), codes)
    held = np.vstack([codes[:1], np.repeat(codes[1:], 20, axis=0)])
    shifted = np.zeros_like(held)
    for axis, tau in enumerate((tau_x, tau_y)):
        whole = round(20 * tau)
        shifted[whole + 1 :, axis] = held[1 : len(held) - whole, axis]
    fast = record(scenario({"board": {"sample_rate_Hz": 80000.0}}), shifted)
    assert_same_motion(states(slow.truth), states(fast.truth)[::20])


def test_ring_down_in_closed_form() -> None:
    what = scenario({"truth": {"damping_N_s_per_m": [0.02, 0.01, 0.0], "stiffness_N_per_m": [1600, 1500, 0]}})
    truth = record(what, undriven(2000)).truth
    t = np.arange(2000) * TS
    decay = 0.5 * 0.02 / 1e-3
    damped = np.sqrt(1600 / 1e-3 - decay**2)
    expected = AMPLITUDE_M * np.exp(-decay * t) * (np.cos(damped * t) + decay / damped * np.sin(damped * t))
    np.testing.assert_allclose(truth["x_m"], expected, rtol=0, atol=1e-9 * AMPLITUDE_M)
    np.testing.assert_array_equal(truth["y_m"], 0.0)


@pytest.mark.parametrize("samples_per_cycle", [5, 20, 50, 100, 400])
def test_its_frequency_is_right_at_any_sampling_rate(samples_per_cycle: int) -> None:
    """A hundred cycles without loss: few steps between samples that are close together are as good as many."""
    rate_Hz = 200.0 * samples_per_cycle
    what = scenario(IDEAL, {"board": {"sample_rate_Hz": rate_Hz}})
    truth = record(what, undriven(100 * samples_per_cycle)).truth
    expected = AMPLITUDE_M * np.cos(OMEGA * np.arange(100 * samples_per_cycle) / rate_Hz)
    np.testing.assert_allclose(truth["x_m"], expected, rtol=0, atol=1e-8 * AMPLITUDE_M)


@pytest.mark.parametrize(
    "rate",
    [
        {"kind": "constant", "rate_rad_s": 30.0},
        {"kind": "steps", "times_s": [0.0, 0.05, 0.1003], "rates_rad_s": [20.0, -50.0, 35.0]},
        SINE,
        {"kind": "ramp", "duration_s": 0.2, "from_rad_s": -20.0, "to_rad_s": 60.0},
    ],
    ids=lambda r: r["kind"],
)
def test_an_ideal_mass_keeps_its_place_in_inertial_space(rate: dict[str, Any]) -> None:
    """Foucault: seen from the board the pattern turns by θ = -∫Ω dt, exactly, steps and all."""
    first = {"constant": 30.0, "steps": 20.0, "sine": 10.0 + 40.0 * np.sin(0.3), "ramp": -20.0}[rate["kind"]]
    what = scenario(IDEAL, {"truth": {"velocity_mps": [0.0, -first * AMPLITUDE_M]}, "rate": rate})
    truth = record(what, undriven(1200)).truth
    t = np.arange(1200) * TS
    line, phi = AMPLITUDE_M * np.cos(OMEGA * t), truth["angle_rad"]
    assert np.ptp(phi) > 1.0
    np.testing.assert_allclose(truth["x_m"], line * np.cos(phi), rtol=0, atol=1e-9 * AMPLITUDE_M)
    np.testing.assert_allclose(truth["y_m"], -line * np.sin(phi), rtol=0, atol=1e-9 * AMPLITUDE_M)
    speed = -AMPLITUDE_M * OMEGA * np.sin(OMEGA * t)
    vx = speed * np.cos(phi) + truth["rate_rad_s"] * truth["y_m"]
    np.testing.assert_allclose(truth["vx_mps"], vx, rtol=0, atol=1e-9 * AMPLITUDE_M * OMEGA)


def test_rate_and_angle_of_a_step_on_a_tick_hold_from_that_row_on() -> None:
    steps = {"kind": "steps", "times_s": [0.0, 10 * TS], "rates_rad_s": [1.0, 3.0]}
    truth = record(scenario({"rate": steps}), undriven(20)).truth
    np.testing.assert_array_equal(truth["rate_rad_s"], [1.0] * 10 + [3.0] * 10)
    np.testing.assert_allclose(truth["angle_rad"][15], (10 + 5 * 3.0) * TS, rtol=1e-12)


@pytest.mark.moderate
def test_thermal_equilibrium() -> None:
    """Equipartition: m <v vᵀ> = kB T and K <x xᵀ> = kB T, cross-damping and cross-stiffness included."""
    damping, temperature = [0.4, 0.25, 0.1], 300.0
    what = scenario(
        {
            "truth": {
                "temperature_K": temperature,
                "damping_N_s_per_m": damping,
                "stiffness_N_per_m": [1700.0, 1500.0, 300.0],
                "position_m": [0.0, 0.0],
            }
        }
    )
    n = 300_000
    truth = record(what, undriven(n)).truth
    settled = slice(2000, None)
    v = np.array([truth["vx_mps"][settled], truth["vy_mps"][settled]])
    x = np.array([truth["x_m"][settled], truth["y_m"][settled]])
    mass, kt = what.truth.mass_kg, KB * temperature
    kxx, kyy, kxy = what.truth.stiffness_N_per_m
    # Energy is forgotten at a rate of d/m or faster, so a second holds about d/m independent values; five
    # standard errors of a mean of squares.
    independent = n * TS * min(np.linalg.eigvalsh([[0.4, 0.1], [0.1, 0.25]])) / mass
    bound = 5.0 * np.sqrt(2.0 / independent)
    assert bound < 0.06
    np.testing.assert_allclose(mass * np.cov(v) / kt, np.eye(2), rtol=0, atol=bound)
    np.testing.assert_allclose(np.array([[kxx, kxy], [kxy, kyy]]) @ np.cov(x) / kt, np.eye(2), rtol=0, atol=bound)


@pytest.mark.moderate
def test_amplifier_noise_has_the_density_stated() -> None:
    """White force of one-sided density S on a damped oscillator: <v²> = S / 4d per axis, per unit mass."""
    density, damping = 2e-3, 0.4
    what = scenario(
        {
            "truth": {"damping_N_s_per_m": [damping, damping, 0.0], "position_m": [0.0, 0.0]},
            "drive": {"noise_mps2_per_rtHz": density},
        }
    )
    n = 300_000
    truth = record(what, undriven(n)).truth
    expected = density**2 / (4.0 * damping / what.truth.mass_kg)
    bound = 5.0 * np.sqrt(2.0 / (n * TS * damping / what.truth.mass_kg))
    for name in ("vx_mps", "vy_mps"):
        assert np.var(truth[name][2000:]) == pytest.approx(expected, rel=bound)
