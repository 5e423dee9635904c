"""Hidden effects against SciPy's integrator and closed forms, each written down anew from its equation."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from device_emulator.effects.kinds import DECLARATIONS
from device_emulator.scenario import Scenario
from tests.emulator.gyro import AMPLITUDE_M, IDEAL, OMEGA, record, scenario, undriven, volts
from tests.play import integrated

TS = 1.0 / 4000.0
A = AMPLITUDE_M
LSB = 0.5 / 2**24
GAIN = -885.41878128
KA = OMEGA**2 * A
WARM = {"warm_up_K": 8.0, "time_constant_s": 0.01, "swing_K": 3.0, "period_s": 0.02}

Floats = NDArray[np.float64]
Law = Callable[[float, Floats, float, float, float, float], tuple[float, float, list[float]]]


def warmer(t: float) -> float:
    return 8.0 * (1.0 - np.exp(-t / 0.01)) + 3.0 * np.sin(2 * np.pi * t / 0.02)


def sine_rate(t: float) -> tuple[float, float]:
    w = 2.0 * np.pi * 25.0
    return 10.0 + 40.0 * np.sin(w * t + 0.3), 40.0 * w * np.cos(w * t + 0.3)


SINE = {"kind": "sine", "amplitude_rad_s": 40.0, "frequency_Hz": 25.0, "phase_rad": 0.3, "offset_rad_s": 10.0}
LOSSY = {
    "stiffness_N_per_m": [1650.0, 1520.0, 60.0],
    "damping_N_s_per_m": [0.05, 0.02, 0.01],
    "position_m": [A, 0.6 * A],
    "velocity_mps": [0.02, -0.05],
}
K = np.array([[1650.0, 60.0], [60.0, 1520.0]]) / 1e-3
D = np.array([[0.05, 0.01], [0.01, 0.02]]) / 1e-3


def integrate(drive: Callable[[float], Floats], rows: int, law: Law, inner: int, breaks: Any = ()) -> Floats:
    """Rows of [x, ẋ, y, ẏ, …] of the lossy device under `drive(t)` (2,), with an effect's `law`."""

    def motion(t: float, s: Floats) -> list[float]:
        x, vx, y, vy = s[:4]
        w, dw = sine_rate(t)
        u = drive(t)
        hx, hy, own = law(t, s, u[0], u[1], w, dw)
        pull = K @ [x, y] + D @ [vx, vy]
        return [vx, u[0] + 2 * w * vy + w * w * x + dw * y - pull[0] + hx,
                vy, u[1] - 2 * w * vx + w * w * y - dw * x - pull[1] + hy, *own]  # fmt: skip

    state = np.concatenate([[A, 0.02, 0.6 * A, -0.05], np.zeros(inner)])
    found = [state]
    for row in range(1, rows):
        edges = [(row - 1) * TS, *(b for b in breaks if (row - 1) * TS < b < row * TS), row * TS]
        for begin, end in itertools.pairwise(edges):
            # A hair inside, so that the drive is taken on the side of its steps that is meant.
            span = (begin, end)
            state = solve_ivp(
                lambda t, s, b=begin, e=end: motion(min(max(t, b + 1e-12), e - 1e-12), s),
                span, state, method="DOP853", rtol=1e-11, atol=1e-16, max_step=TS / 20,
            ).y[:, -1]  # fmt: skip
        found.append(state)
    return np.array(found)


def pushes(rows: int) -> NDArray[np.int32]:
    return np.random.default_rng(7).integers(-32767, 32768, (rows, 2)).astype(np.int32)


def held(codes: NDArray[np.int32]) -> Callable[[float], Floats]:
    forces = codes * (10.0 / 32768)
    return lambda t: np.asarray(forces[min(int(t / TS) + 1, len(forces) - 1)])


def with_effect(**effect: Any) -> Scenario:
    return scenario({"truth": LOSSY, "rate": SINE, "temperature": WARM, "effect": [effect]})


def motion_of(what: Scenario, codes: NDArray[np.int32]) -> Floats:
    truth = record(what, codes).truth
    return np.column_stack([truth[name] for name in ("x_m", "vx_mps", "y_m", "vy_mps")])


def assert_same(ours: Floats, theirs: Floats, tolerance: float) -> None:
    scale = np.array([1.0, OMEGA, 1.0, OMEGA]) * A
    np.testing.assert_allclose(ours / scale, theirs[:, :4] / scale, rtol=0, atol=tolerance)


def _bristle(reaction: float, s: Floats) -> list[float]:
    """One axis of the support: ratio 0.01, 60 Hz, Fs 0.9, Fc 0.6 m/s², vs 5e-4 m/s, s (2π 400)²."""
    stiff = (2 * np.pi * 400.0) ** 2
    grip = 0.6 + 0.3 * np.exp(-((s[1] / 5e-4) ** 2))
    dz = s[1] - stiff * abs(s[1]) * s[2] / grip
    return [s[1], 0.01 * reaction - (2 * np.pi * 60.0) ** 2 * s[0] - stiff * s[2] - np.sqrt(stiff) * dz, dz]


def _support(t: float, s: Floats, ux: float, uy: float, w: float, dw: float) -> tuple[float, float, list[float]]:
    reaction = K @ s[[0, 2]] + D @ s[[1, 3]] - [ux, uy]
    first, second = _bristle(reaction[0], s[4:7]), _bristle(reaction[1], s[7:10])
    return -first[1], -second[1], [*first, *second]


def _bouc_wen(t: float, s: Floats, ux: float, uy: float, w: float, dw: float) -> tuple[float, float, list[float]]:
    own = [v - (abs(v) * z + v * abs(z)) / (2 * 3e-5) for v, z in ((s[1], s[4]), (s[3], s[5]))]
    return -3e4 * s[4], -2e4 * s[5], own


def _dragged(t: float, s: Floats, ux: float, uy: float, w: float, dw: float) -> tuple[float, float, list[float]]:
    """Feet of 30 µm to either side, counted from where the mass leaves them that came from 0 to where it starts."""
    feet = s[4:6] + np.array([A - 3e-5, 0.6 * A - 3e-5])
    far = s[[0, 2]] - feet
    own = np.where((np.abs(far) >= 3e-5) & (far * s[[1, 3]] > 0.0), s[[1, 3]], 0.0)
    return -3e4 * float(far[0]), -2e4 * float(far[1]), list(own)


def _play(x: float) -> float:
    return float(x - np.clip(x, -4e-5, 4e-5))


def _rubbing(v: float, asymmetry: float) -> float:
    rub = np.tanh(v / 0.02)
    return float(rub + asymmetry * rub**2)


def _against(v: Floats, loss: float) -> tuple[float, float, list[float]]:
    return -loss * float(v[0]), -loss * float(v[1]), []


CASES: dict[str, tuple[dict[str, float], Law, int, float]] = {
    # effect: coefficients, its law, its states, tolerance (of A)
    "dry_friction_asymmetric": (
        {"fx": 2.0, "fy": 3.0, "v0": 0.02, "ax": 0.3, "ay": -0.2},
        lambda t, s, ux, uy, w, dw: (-2.0 * _rubbing(s[1], 0.3), -3.0 * _rubbing(s[3], -0.2), []),
        0,
        1e-8,
    ),
    "stribeck_friction": (
        {"stx": 2.0, "sty": 3.0, "v0": 0.02, "vs": 0.1},
        lambda t, s, ux, uy, w, dw: (
            -2.0 * np.tanh(s[1] / 0.02) * np.exp(-((s[1] / 0.1) ** 2)),
            -3.0 * np.tanh(s[3] / 0.02) * np.exp(-((s[3] / 0.1) ** 2)),
            [],
        ),
        0,
        1e-8,
    ),
    "damping_asymmetric": (
        {"dax": 20.0, "day": -15.0},
        lambda t, s, ux, uy, w, dw: (-20.0 * abs(s[1]), 15.0 * abs(s[3]), []),
        0,
        1e-6,  # no step of ours ends where the velocity turns
    ),
    "drag": (
        {"dqx": 80.0, "dqy": 50.0},
        lambda t, s, ux, uy, w, dw: (-80.0 * s[1] * abs(s[1]), -50.0 * s[3] * abs(s[3]), []),
        0,
        1e-8,
    ),
    "cubic_damping": (
        {"dcx": 300.0, "dcy": 200.0},
        lambda t, s, ux, uy, w, dw: (-300.0 * s[1] ** 3, -200.0 * s[3] ** 3, []),
        0,
        2e-10,
    ),
    "nonlinear_damping_radial": (
        {"d3r": 1e10},
        lambda t, s, ux, uy, w, dw: _against(s[[1, 3]], 1e10 * float(s[[0, 2]] @ s[[0, 2]])),
        0,
        2e-10,
    ),
    "drag_radial": (
        {"dqr": 80.0},
        lambda t, s, ux, uy, w, dw: _against(s[[1, 3]], 80.0 * float(np.linalg.norm(s[[1, 3]]))),
        0,
        1e-8,
    ),
    "cubic_damping_radial": (
        {"dcr": 300.0},
        lambda t, s, ux, uy, w, dw: _against(s[[1, 3]], 300.0 * float(s[[1, 3]] @ s[[1, 3]])),
        0,
        2e-10,
    ),
    "dry_friction_radial": (
        {"fr": 2.0, "v0": 0.02},
        lambda t, s, ux, uy, w, dw: _against(s[[1, 3]], 2.0 / float(np.sqrt(s[[1, 3]] @ s[[1, 3]] + 0.02**2))),
        0,
        1e-8,
    ),
    "nonreciprocal_stiffness": (
        {"kn": 4e4},
        lambda t, s, ux, uy, w, dw: (-4e4 * s[2], 4e4 * s[0], []),
        0,
        2e-10,
    ),
    "angular_gain": (
        {"kappa": -0.3},
        lambda t, s, ux, uy, w, dw: (
            -0.3 * (2 * w * s[3] + dw * s[2]),
            0.3 * (2 * w * s[1] + dw * s[0]),
            [],
        ),
        0,
        2e-10,
    ),
    "temperature_stiffness": (
        {"tc": -2e-3},
        lambda t, s, ux, uy, w, dw: (*(2e-3 * warmer(t) * (K @ s[[0, 2]])), []),
        0,
        2e-10,
    ),
    "temperature_damping": (
        {"tc": 0.05},
        lambda t, s, ux, uy, w, dw: (*(-0.05 * warmer(t) * (D @ s[[1, 3]])), []),
        0,
        2e-10,
    ),
    "parametric_stiffness": (
        {"depth": 0.03, "frequency": 90.0, "phase": 0.4},
        lambda t, s, ux, uy, w, dw: (*(-0.03 * np.sin(2 * np.pi * 90.0 * t + 0.4) * (K @ s[[0, 2]])), []),
        0,
        2e-10,
    ),
    "nonlinear_coupling": (
        {"c": 3e12},
        lambda t, s, ux, uy, w, dw: (-9e12 * s[0] ** 2 * s[2], -3e12 * s[0] ** 3, []),
        0,
        2e-10,
    ),
    "unequal_masses": (
        {"m": 0.3},
        # M r̈ = F: all forces on y, over 1.3 in place of 1; what goes with w² is no force.
        lambda t, s, ux, uy, w, dw: (
            0.0,
            (uy - 2 * w * s[1] - dw * s[0] - K[1] @ s[[0, 2]] - D[1] @ s[[1, 3]]) * (1 / 1.3 - 1),
            [],
        ),
        0,
        2e-10,
    ),
    "backlash": (
        {"kbx": 5e4, "kby": 3e4, "gap": 4e-5},
        lambda t, s, ux, uy, w, dw: (-5e4 * _play(s[0]), -3e4 * _play(s[2]), []),
        0,
        3e-6,  # no step of ours ends where the play does
    ),
    "play": (
        {"kpx": 3e4, "kpy": 2e4, "half_width": 3e-5},
        _dragged,
        2,
        3e-6,  # theirs: no step of SciPy's ends where a foot is caught; see below
    ),
    "hysteretic_stiffness": ({"khx": 3e4, "khy": 2e4, "reach": 3e-5}, _bouc_wen, 2, 1e-6),
    "stick_slip_support": (
        {"ratio": 0.01, "frequency": 60.0, "Fs": 0.9, "Fc": 0.6, "vs": 5e-4, "s": (2 * np.pi * 400.0) ** 2},
        _support,
        6,
        1e-5,
    ),
}


@pytest.mark.slow
def test_every_effect_has_a_case_against_a_law_written_by_hand() -> None:
    here = Path(__file__).parent
    written = "".join((here / f"test_{name}.py").read_text(encoding="utf-8") for name in ("effects", "plant", "sense"))
    assert [name for name in DECLARATIONS if f'"{name}"' not in written] == []


@pytest.mark.parametrize("name", CASES)
def test_what_acts_on_the_mass(name: str) -> None:
    coefficients, law, inner, tolerance = CASES[name]
    codes = pushes(60)
    ours = motion_of(with_effect(name=name, **coefficients), codes)
    assert_same(ours, integrate(held(codes), 60, law, inner), tolerance)
    # ... and it does something, a hundred times more than what is tolerated.
    plain = motion_of(scenario({"truth": LOSSY, "rate": SINE}), codes)
    assert np.abs(ours - plain)[:, 0].max() > 100 * tolerance * A


@pytest.mark.moderate
@pytest.mark.parametrize(("kp", "width"), [(0.03, 3e-5), (0.2, 8e-5), (0.05, 2e-6), (0.03, 2e-4)])
def test_a_foot_with_play_is_caught_and_left_between_the_steps(kp: float, width: float) -> None:
    k = OMEGA**2
    play = {"name": "play", "kpx": kp * k, "kpy": 0.0, "half_width": width}
    forces = pushes(120)
    forces[:, 1] = 0
    truth = {**IDEAL["truth"], "position_m": [1.3e-4, 0.0], "velocity_mps": [0.0, 0.0]}
    ours = record(scenario({"truth": truth, "effect": [play]}), forces).truth
    t = np.arange(120) * TS
    theirs = integrated(k, 0.0, kp * k, width, 1.3e-4, t, lambda at: held(forces)(at)[0])
    np.testing.assert_allclose(ours["x_m"], theirs[0], rtol=0, atol=1e-9 * A)
    np.testing.assert_allclose(ours["vx_mps"], theirs[1], rtol=0, atol=1e-9 * A * OMEGA)
    assert np.abs(np.diff(theirs[2])).max() > 0.01 * A or width > 1.3e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "bent"),
    [
        ({"name": "drive_saturation", "limit_x": 4.0, "limit_y": 6.0}, lambda u: np.clip(u, [-4, -6], [4, 6])),
        ({"name": "drive_dead_band", "width_x": 1.0, "width_y": 2.0}, lambda u: u - np.clip(u, [-1, -2], [1, 2])),
        ({"name": "drive_polarity", "px": 1.0}, lambda u: u * [-1, 1]),
        ({"name": "drive_polarity", "px": 1, "py": 1}, lambda u: -u),
        ({"name": "electrostatic_drive", "qx": 0.01, "qy": -0.02}, lambda u: u + np.array([0.01, -0.02]) * u**2),
    ],
    ids=lambda v: v["name"] if isinstance(v, dict) else "",
)
def test_what_the_drive_makes_of_a_command(effect: dict[str, Any], bent: Callable[[Floats], Floats]) -> None:
    codes = pushes(60)
    base = held(codes)
    expected = integrate(lambda t: bent(base(t)), 60, lambda *_: (0.0, 0.0, []), 0)
    assert_same(motion_of(with_effect(**effect), codes), expected, 2e-10)


@pytest.mark.parametrize(("px", "py"), [(1, 0), (0, 1), (1, 1)])
def test_a_reversed_sense_turns_the_motion_s_sign_and_not_its_offset_s(px: int, py: int) -> None:
    where = {"truth": LOSSY, "sense": {"mismatch_m": [1e-5, -2e-5], "adc_bits": 24}}
    delay = {"name": "sense_delay", "tsx": 0.4 * TS, "tsy": 1.7 * TS}
    for others in ([], [delay]):
        plain = scenario(where, {"effect": others})
        turned = scenario(where, {"effect": [*others, {"name": "sense_polarity", "px": px, "py": py}]})
        codes = undriven(100)
        ours, theirs = (volts(what, record(what, codes).codes) for what in (turned, plain))
        truth = record(plain, codes).truth
        offset = np.column_stack([truth["phi_x_V"], truth["phi_y_V"]])
        expected = offset + (theirs - offset) * [1 - 2 * px, 1 - 2 * py]
        np.testing.assert_allclose(ours, expected, rtol=0, atol=2 * LSB)
        assert np.abs(ours - theirs).max() > 0.01


def test_a_rate_that_steps_turns_the_heavier_axis_less() -> None:
    """The impulse of the Euler force is of the mass that both axes move."""
    steps = {"kind": "steps", "times_s": [0.0, 10.4 * TS], "rates_rad_s": [0.0, 50.0]}

    def push_of(m: float) -> float:
        what = scenario(IDEAL, {"rate": steps, "effect": [{"name": "unequal_masses", "m": m}]})
        y = record(what, undriven(13)).truth["y_m"]
        return float(y[-1])

    assert push_of(0.25) / push_of(0.0) == pytest.approx(1.0 / 1.25, rel=1e-2)


@pytest.mark.parametrize(
    ("effect", "complaint"),
    [
        ({"name": "drive_polarity", "px": -1.0}, "expected 0 or 1 for px"),
        ({"name": "sense_polarity", "py": 0.5}, "expected 0 or 1 for py"),
        ({"name": "unequal_masses", "m": -1.0}, "expected a number above -1 for m"),
        ({"name": "unequal_masses"}, "unequal_masses needs m"),
    ],
    ids=str,
)
def test_what_no_bench_could_have_is_refused(effect: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        with_effect(**effect)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.3, 1.7])
def test_slew(delay: float) -> None:
    """Straight lines from where the last interval ended, as steep as allowed, the delay after them."""
    codes = pushes(40)
    forces, steep = codes * (10.0 / 32768), np.array([8.0 / TS, 3.0 / TS])
    ends = [np.zeros(2)]
    for wanted in forces[1:]:
        ends.append(ends[-1] + np.clip(wanted - ends[-1], -steep * TS, steep * TS))

    def drive(t: float) -> Floats:
        out = np.zeros(2)
        for axis in range(2):
            at = t - (delay * TS if axis == 0 else 0.0)
            row = int(np.floor(at / TS)) + 1
            if row >= 1:
                far = forces[row, axis] - ends[row - 1][axis]
                out[axis] = ends[row - 1][axis] + np.clip(
                    far, *(np.array([-1, 1]) * steep[axis] * (at - (row - 1) * TS))
                )
        return out

    kinks = sorted(
        (row - 1 + lag + on * min(abs(forces[row, axis] - ends[row - 1][axis]) / steep[axis] / TS, 1.0)) * TS
        for axis, lag in ((0, delay), (1, 0.0))
        for row in range(1, 40)
        for on in (0.0, 1.0)
    )
    effects = [
        {"name": "drive_slew", "slew_x": steep[0], "slew_y": steep[1]},
        {"name": "drive_delay", "tux": delay * TS},
    ]
    what = scenario({"truth": LOSSY, "rate": SINE, "effect": effects})
    expected = integrate(drive, 40, lambda *_: (0.0, 0.0, []), 0, kinks)
    assert_same(motion_of(what, codes), expected, 2e-10)


@pytest.mark.moderate
def test_parasitic_mode_rings_in_the_sense_only() -> None:
    """Against the mode integrated alone; the mass does not feel it."""
    codes = pushes(80)
    what = with_effect(name="parasitic_mode", frequency=730.0, zeta=0.02, rx=0.3, ry=-0.2)
    ours, truth, _ = record(what, codes)
    np.testing.assert_array_equal(
        truth["x_m"], record(scenario({"truth": LOSSY, "rate": SINE, "temperature": WARM}), codes).truth["x_m"]
    )
    w = 2 * np.pi * 730.0

    def law(t: float, s: Floats, ux: float, uy: float, rate: float, slope: float) -> tuple[float, float, list[float]]:
        px, vpx, py, vpy = s[4:]
        return 0.0, 0.0, [vpx, 0.3 * ux - 0.04 * w * vpx - w * w * px, vpy, -0.2 * uy - 0.04 * w * vpy - w * w * py]

    found = integrate(held(codes), 80, law, 4)
    ring = found[:, [4, 6]]
    assert np.abs(ring).max() > 1e-3 * A
    np.testing.assert_allclose(
        volts(what, ours), GAIN * (found[:, [0, 2]] + ring), rtol=0, atol=LSB + 2e-8 * abs(GAIN) * A
    )


@pytest.mark.parametrize("delay", [0.0, 1.3])
def test_parasitic_mode_passes_the_delay_of_the_sense_chain(delay: float) -> None:
    """A free vibration and a mode at rest: with no drive there is nothing to see of it."""
    effects = [
        {"name": "parasitic_mode", "frequency": 730.0, "zeta": 0.02, "rx": 0.3},
        {"name": "sense_delay", "tsx": delay * TS},
    ]
    codes = record(scenario(IDEAL, {"effect": effects}), undriven(100)).codes
    np.testing.assert_array_equal(codes, record(scenario(IDEAL, {"effect": effects[1:]}), undriven(100)).codes)


def test_sense_saturation_clips_offset_and_all_but_not_the_noise() -> None:
    limits = {"name": "sense_clipping", "limit_x": 0.06, "limit_y": 0.03}
    where = {"truth": {"position_m": [A, 0.6 * A]}, "sense": {"mismatch_m": [1e-5, -2e-5], "adc_bits": 24}}
    what = scenario(where, {"effect": [limits]})
    codes, truth, device = record(what, undriven(100))
    exact = np.column_stack([GAIN * truth["x_m"] + truth["phi_x_V"], GAIN * truth["y_m"] + truth["phi_y_V"]])
    np.testing.assert_allclose(volts(what, codes), np.clip(exact, [-0.06, -0.03], [0.06, 0.03]), rtol=0, atol=LSB)
    assert not device.clipped
    noisy = scenario(where, {"sense": {"noise_V": 1e-3}, "effect": [limits]})
    flat = np.abs(exact[:, 0]) > 0.06
    assert flat.sum() > 20
    assert np.ptp(volts(noisy, record(noisy, undriven(100)).codes)[flat & (exact[:, 0] > 0), 0]) > 1e-3


def test_thermal_offset_follows_the_temperature() -> None:
    what = scenario(
        {"truth": {"position_m": [0, 0]}, "temperature": WARM},
        {"effect": [{"name": "temperature_offset", "tc_x": 1e-3, "tc_y": -2e-3}]},
    )
    codes = record(what, undriven(200)).codes
    warm = np.array([warmer(t) for t in np.arange(200) * TS])
    np.testing.assert_allclose(volts(what, codes), np.outer(warm, [1e-3, -2e-3]), rtol=0, atol=LSB)


@pytest.mark.slow
def test_random_telegraph() -> None:
    """Two levels; Poisson's changes leave an autocorrelation of exp(-2 rate lag), and the axes know nothing of each
    other.
    """
    rate, n = 40.0, 120_000
    effect = {"name": "telegraph_offset", "ax": 0.02, "ay": 0.01, "rate": rate}
    what = scenario({"truth": {"position_m": [0, 0]}, "effect": [effect]})
    levels = volts(what, record(what, undriven(n)).codes) / [0.02, 0.01]
    np.testing.assert_allclose(np.abs(levels), 1.0, rtol=0, atol=LSB / 0.01)
    independent = n * TS * rate  # about as many values as there are changes
    for lag in (20, 50, 100):
        expected = np.exp(-2.0 * rate * lag * TS)
        found = np.mean(levels[lag:] * levels[:-lag], axis=0)
        np.testing.assert_allclose(found, expected, rtol=0, atol=5.0 / np.sqrt(independent))
    assert abs(np.mean(levels[:, 0] * levels[:, 1])) < 5.0 / np.sqrt(independent)
    changes = np.count_nonzero(np.diff(levels[:, 0]))
    assert changes == pytest.approx(independent, abs=5.0 * np.sqrt(independent))
    few = undriven(2000)
    assert (record(what, few, seed=2).codes != record(what, few).codes).any()


def test_missing_codes() -> None:
    plain = record(scenario(IDEAL, {"sense": {"adc_bits": 12}}), undriven(400)).codes
    flawed = record(
        scenario(IDEAL, {"sense": {"adc_bits": 12}}, {"effect": [{"name": "missing_codes", "every": 64, "width": 20}]}),
        undriven(400),
    ).codes
    low = plain % 64
    np.testing.assert_array_equal(flawed, np.where(low < 20, plain - low, plain))
    assert (flawed != plain).any()


def test_a_step_of_the_rate_turns_the_velocity_by_what_the_mass_feels() -> None:
    """With κ = -1 the mass feels no Coriolis or Euler force at all, only the centrifugal one."""
    steps = {"kind": "steps", "times_s": [0.0, 10.4 * TS], "rates_rad_s": [0.0, 50.0]}
    what = scenario(IDEAL, {"rate": steps, "effect": [{"name": "angular_gain", "kappa": -1.0}]})
    np.testing.assert_array_equal(record(what, undriven(100)).truth["y_m"], 0.0)


@pytest.mark.moderate
def test_a_support_that_slips_takes_more_than_a_damped_spring() -> None:
    """Far below break-away bristles are springs with dampers, and all is linear: the decay is an eigenvalue's."""
    ratio, w, stiff = 0.01, 2 * np.pi * 20.0, (2 * np.pi * 400.0) ** 2

    def energy(static: float) -> Floats:
        support = {"name": "stick_slip_support", "ratio": ratio, "frequency": 20.0, "Fs": static, "Fc": 0.6 * static,
                   "vs": 5e-4, "s": stiff}  # fmt: skip
        truth = record(scenario(IDEAL, {"effect": [support]}), undriven(2000)).truth
        return np.asarray((OMEGA * truth["x_m"]) ** 2 + truth["vx_mps"] ** 2)

    k = OMEGA**2
    package = [ratio * k, 0.0, -(w**2) - stiff, -np.sqrt(stiff)]
    modes = np.linalg.eigvals([[0, 1, 0, 0], np.array([-k, 0, 0, 0]) - package, [0, 0, 0, 1], package])
    decay = modes[np.argmin(np.abs(modes.imag - OMEGA))].real
    holds, slips = energy(1e6), energy(0.5 * ratio * KA)
    cycle = 20
    measured = np.log(holds[-10 * cycle :].mean() / holds[: 10 * cycle].mean()) / ((2000 - 10 * cycle) * TS)
    assert measured == pytest.approx(2.0 * decay, rel=1e-3)
    assert slips[-200:].mean() < 0.9 * holds[-200:].mean()
