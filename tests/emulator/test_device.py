"""The device as a machine: reproducible, indifferent to how its rows are asked for, true to its truth."""

import numpy as np
import pytest

from device_emulator.device import PAGE, TRUTH_COLUMNS, Device
from device_emulator.effects.kinds import DECLARATIONS
from device_emulator.scenario import Scenario, load
from tests.emulator.gyro import EXAMPLES, document, record, scenario, undriven

N = 3 * PAGE + 10


def noisy() -> Scenario:
    return load(EXAMPLES / "s-slow.scenario.toml")


def drive(n: int) -> np.ndarray[tuple[int, int], np.dtype[np.int32]]:
    return np.random.default_rng(5).integers(-9000, 9000, (n, 2)).astype(np.int32)


@pytest.mark.moderate
def test_one_seed_one_record() -> None:
    first, second = record(noisy(), drive(N)), record(noisy(), drive(N))
    np.testing.assert_array_equal(first.codes, second.codes)
    for name in TRUTH_COLUMNS:
        np.testing.assert_array_equal(first.truth[name], second.truth[name])
    other = record(noisy(), drive(N), seed=99)
    assert (other.codes != first.codes).any(axis=0).all()


@pytest.mark.parametrize("prepare", [False, True])
def test_rows_do_not_depend_on_how_they_are_asked_for(prepare: bool) -> None:
    codes = drive(N)
    at_once = record(noisy(), codes)
    pages = []
    device = Device(noisy(), sink=lambda tick, rows: pages.append((tick, rows.copy())))
    singly = []
    for ux, uy in codes.tolist():
        singly += device.rows([[ux, uy]]).tolist()
        if prepare:
            device.prepare()
    device.close()
    np.testing.assert_array_equal(singly, at_once.codes)
    np.testing.assert_array_equal(np.vstack([rows for _, rows in pages])[:, 0], at_once.truth["x_m"])
    assert [tick for tick, _ in pages] == [0, PAGE, 2 * PAGE, 3 * PAGE]
    assert device.tick == N - 1


def test_a_whole_last_page_is_not_lost() -> None:
    pages: list[int] = []
    device = Device(noisy(), sink=lambda tick, rows: pages.append(len(rows)))
    device.rows(undriven(2 * PAGE))
    device.close()
    assert pages == [PAGE, PAGE]


def test_row_zero_shows_the_start_and_ignores_its_drive() -> None:
    what = scenario({"truth": {"position_m": [1e-4, -2e-5], "velocity_mps": [0.01, 0.02]}})
    pushed = np.full((2, 2), 30000, np.int32)
    _, truth, _ = record(what, pushed)
    start = [truth[name][0] for name in ("x_m", "vx_mps", "y_m", "vy_mps", "angle_rad")]
    assert start == [1e-4, 0.01, -2e-5, 0.02, 0.0]


def test_a_drive_acts_over_the_interval_that_ends_at_its_row() -> None:
    quiet = scenario({"truth": {"position_m": [0.0, 0.0]}})
    codes = undriven(6)
    codes[3] = 20000, -10000
    truth = record(quiet, codes).truth
    ts, scale = 1 / 4000.0, 10.0 / 32768
    np.testing.assert_array_equal(truth["x_m"][:3], 0.0)
    # Half u Ts², short by (ω Ts)²/12 of it for the spring.
    assert truth["x_m"][3] == pytest.approx(0.5 * 20000 * scale * ts**2, rel=0.01)
    assert truth["y_m"][3] == pytest.approx(-0.5 * 10000 * scale * ts**2, rel=0.01)
    assert truth["x_m"][4] == pytest.approx(1.5 * 20000 * scale * ts**2, rel=0.07)


def test_hidden_effects_leave_the_noise_alone() -> None:
    """An effect of size zero changes nothing, so two records differ by the effect only."""
    plain = record(noisy(), drive(N))
    nothing = Scenario.model_validate(document({"effect": [{"name": "cubic_stiffness", "k3x": 0.0}]}))
    np.testing.assert_array_equal(record(nothing, drive(N)).codes, plain.codes)


@pytest.mark.parametrize("name", DECLARATIONS)
def test_every_declared_effect_acts_through_each_of_its_coefficients(name: str) -> None:
    """Each coefficient, moved alone, shows in the codes."""
    sizes = {
        "k3x": 1e13, "k3y": 1e13, "k3": 1e13, "k5x": 1e21, "k5y": 1e21, "k5r": 1e21, "k2x": 1e9, "k2y": 1e9,
        "d3x": 1e9, "d3y": 1e9,
        "fx": 1.0, "fy": 1.0, "fr": 1.0, "stx": 1.0, "sty": 1.0, "d3r": 1e9, "dqx": 100.0, "dqy": 100.0, "dqr": 100.0,
        "dcx": 300.0, "dcy": 300.0, "dcr": 300.0, "dax": 30.0, "day": 30.0,
        "v0": 0.1, "gx": 0.1, "gy": 0.1, "hx": 0.1, "hy": 0.1, "mx": 0.1, "my": 0.1,
        "ax": 1e-2, "ay": 1e-2, "frequency": 30.0, "phase_x": 1.0, "phase_y": 1.0,
        "tsx": 1e-4, "tsy": 1e-4, "tux": 1e-4, "tuy": 1e-4, "qx": 0.1, "qy": 0.1, "rx": 1e-3, "ry": 1e-3,
        "a2x": 1e3, "a2y": 1e3, "a3x": 1e7, "a3y": 1e7,
        "gamma_x": 1e-3, "gamma_y": 1e-3, "kn": 1e4, "kappa": 0.1, "tc": 1e-2, "tc_x": 1e-3, "tc_y": 1e-3,
        "kbx": 1e4, "kby": 1e4, "gap": 5e-5, "khx": 1e4, "khy": 1e4, "reach": 5e-5,
        "kpx": 1e4, "kpy": 1e4, "half_width": 5e-5, "ratio": 0.01, "Fs": 1.0, "Fc": 0.5,
        "vs": 1e-3, "s": 6e6, "depth": 0.1, "phase": 1.0, "c": 1e13, "limit_x": 0.04, "limit_y": 0.04,
        "width_x": 0.4, "width_y": 0.4, "slew_x": 2e3, "slew_y": 2e3, "ex": 0.1, "ey": 0.1, "zeta": 0.1,
        "rate": 400.0, "every": 10_000.0, "width": 3000.0, "m": 0.2, "px": 1.0, "py": 1.0,
        "wm": 3e3, "dm": 100.0, "cmx": 0.01, "smx": 0.01, "cmy": 0.01, "smy": 0.01,
    }  # fmt: skip
    where = {
        "truth": {"position_m": [1e-4, 1e-4]},
        "rate": {"kind": "constant", "rate_rad_s": 5.0},
        "temperature": {"warm_up_K": 5.0},
    }
    codes = drive(100)
    full = {c.symbol: sizes[c.symbol] for c in DECLARATIONS[name].coefficients}
    with_all = record(scenario(where, {"effect": [{"name": name, **full}]}), codes).codes
    assert (with_all != record(scenario(where), codes).codes).any()
    for symbol, size in full.items():
        changed = {**full, symbol: 0.0 if symbol in ("px", "py") else 0.5 * size}
        moved = record(scenario(where, {"effect": [{"name": name, **changed}]}), codes).codes
        assert (moved != with_all).any(), symbol


def test_effects_add_up() -> None:
    twice = [{"name": "constant_force", "ax": 1.0}, {"name": "constant_force", "ax": 2.0}]
    once = [{"name": "constant_force", "ax": 3.0}]
    np.testing.assert_array_equal(
        record(scenario({"effect": twice}), drive(50)).codes,
        record(scenario({"effect": once}), drive(50)).codes,
    )


@pytest.mark.parametrize("name", ["s-slow", "s-classic", "s-modern", "s-undeclared"])
def test_examples_run_within_their_converters(name: str) -> None:
    what = load(EXAMPLES / f"{name}.scenario.toml")
    codes, truth, device = record(what, undriven(2000))
    assert not device.clipped
    assert np.abs(codes[:, 0]).max() > 0.25 * 2 ** (what.sense.adc_bits - 1)
    assert np.isfinite(np.array(list(truth.values()))).all()
