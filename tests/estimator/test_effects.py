"""Effects: their flow against an integrator, their derivatives against differences, their declarations against the
page.
"""

from pathlib import Path

import numba
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from estimator.effects.catalogue import EFFECTS, effect_for, names
from estimator.effects.declaration import DRIVES, STATES
from estimator.effects.page import page
from estimator.errors import ModelError
from estimator.kernel.flow import flow
from estimator.kernel.observer import predict_measurement, workspace
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings

OMEGA0 = 2 * np.pi * 200.0
STATE = np.array([0.8, 0.1, -0.3, 0.7])
DRIVE = np.array([[0.02, 0.01], [-0.03, 0.005]])
KINKED = ("dry_friction", "damping_asymmetric", "drag")
FORCES = [effect.name for effect in EFFECTS if any(e != 0 for e in effect.force)]


@numba.njit
def call_flow(record, c, s, u, h, columns, a, b, out, push):
    flow(record[0], c, s, u, h, columns, a, b, out, push)


@numba.njit
def call_measurement(record, active, x, z, u, nu, noise):
    work = workspace(record[0], 4 + active.shape[0], x.shape[0])
    predict_measurement(record[0], active, x, z, u, work, nu, noise)
    return work[5].copy()


def device(axes: int = 2) -> Device:
    k = OMEGA0**2
    return Device(
        sample_rate=4000.0,
        stiffness=(k * 1.02, k * 0.98, k * 0.01) if axes == 2 else (k,),
        damping=(1.3, 1.1, 0.06) if axes == 2 else (1.3,),
        amplitude=1e-4,
        sense_gain=(-890.0,) * axes,
        noise=(1e-4,) * axes,
        target_stiffness=k,
    )


def carrying(name: str, share: float = 0.5) -> Observer:
    """An observer with one effect, its coefficients at a share of their plausible size, scaled values in `x`."""
    observer = Observer(device(), ObserverSettings(effects={name: {}}))
    _, effect = effect_for(name, 2)
    observer.x[13:] = [share * coefficient.plausible for coefficient in effect.coefficients]
    return observer


def step(observer: Observer, s: Array, c: Array) -> Array:
    """[state | ∂/∂s | ∂/∂(flow constants, coefficients)] after one sample."""
    columns = 1 + 4 + int(observer.record["flow_constants"][0])
    a, b, out = (np.zeros((4, columns)) for _ in range(3))
    push = (np.zeros(2), np.zeros((2, 4)), np.zeros((2, len(c))), np.zeros(2))
    call_flow(observer.record, c, s, DRIVE, observer.h, columns, a, b, out, push)
    return out


@pytest.mark.parametrize("name", FORCES)
def test_flow_with_an_effect_is_that_of_an_integrator(name: str) -> None:
    observer = carrying(name)
    c = observer.x[4:]
    _, effect = effect_for(name, 2)
    force = sp.lambdify([STATES, DRIVES, [k.symbol for k in effect.coefficients]], list(effect.force))

    def slope(t: float, y: Array, share: float) -> list[float]:
        u = DRIVE[:, 0] + DRIVE[:, 1] * t / observer.h
        rate, kxx, kyy, kxy, dxx, dyy, dxy = c[2:9]
        fx, fy = (share * f for f in force(y, u, c[9:]))
        return [
            y[1],
            -dxx * y[1] - dxy * y[3] - kxx * y[0] - kxy * y[2] + u[0] + 2 * rate * y[3] + rate**2 * y[0] + fx,
            y[3],
            -dxy * y[1] - dyy * y[3] - kxy * y[0] - kyy * y[2] + u[1] - 2 * rate * y[1] + rate**2 * y[2] + fy,
        ]

    # Dry friction and one-way damping have a kink where the velocity turns, which no scheme of a step a sample
    # resolves: away from there.
    start = np.array([0.1, 0.9, -0.3, 0.7]) if name in KINKED else STATE
    with_effect, without = (
        solve_ivp(slope, (0, observer.h), start, "DOP853", rtol=1e-12, atol=1e-14, args=(share,)).y[:, -1]
        for share in (1.0, 0.0)
    )
    size = np.abs(with_effect - without).max()
    assert np.abs(step(observer, start, c)[:, 0] - with_effect).max() < 2e-5 * size


@pytest.mark.parametrize("name", [name for name in FORCES if name != "dry_friction"])
def test_jacobian_of_the_flow_is_its_difference_quotient(name: str) -> None:
    observer = carrying(name)
    c = observer.x[4:].copy()
    jacobian = step(observer, STATE, c)[:, 1:]
    epsilon = 1e-6
    for column in range(jacobian.shape[1]):
        moved = []
        for sign in (1.0, -1.0):
            s1, c1 = STATE.copy(), c.copy()
            if column < 4:
                s1[column] += sign * epsilon
            else:
                c1[2 + column - 4] += sign * epsilon
            moved.append(step(observer, s1, c1)[:, 0])
        np.testing.assert_allclose(jacobian[:, column], (moved[0] - moved[1]) / (2 * epsilon), rtol=0, atol=2e-9)


@pytest.mark.parametrize("name", [effect.name for effect in EFFECTS if any(e != 0 for e in effect.sense)])
def test_measurement_and_its_jacobian(name: str) -> None:
    observer = carrying(name)
    x = observer.x.copy()
    x[:4] = STATE
    _, effect = effect_for(name, 2)
    shown = sp.lambdify([STATES, DRIVES, [k.symbol for k in effect.coefficients]], list(effect.sense))
    nu, noise = np.zeros(2), np.zeros(2)

    def predicted(x1: Array) -> Array:
        call_measurement(observer.record, observer.active, x1, np.zeros(2), DRIVE, nu, noise)
        return -nu.copy()

    expected = STATE[[0, 2]] + x[4:6] + shown(STATE, DRIVE.sum(axis=1), x[13:])
    np.testing.assert_allclose(predicted(x), expected, rtol=1e-13)
    jacobian = call_measurement(observer.record, observer.active, x, np.zeros(2), DRIVE, nu, noise)
    for column, entry in enumerate(observer.estimated_index):
        ahead, behind = x.copy(), x.copy()
        ahead[entry] += 1e-6
        behind[entry] -= 1e-6
        np.testing.assert_allclose(jacobian[:, column], (predicted(ahead) - predicted(behind)) / 2e-6, atol=1e-8)


def test_coefficients_are_in_si() -> None:
    observer = Observer(device(), ObserverSettings(effects={"cubic_stiffness": {"k3x": 1e13}}))
    assert observer.names[-2:] == ("k3x", "k3y")
    assert observer.x[13] == pytest.approx(1e13 * 1e-8 / OMEGA0**2)  # k3 A²/ω0²
    assert observer.state[13] == pytest.approx(1e13)
    assert observer.coefficient_units == {"k3x": "1/(m²·s²)", "k3y": "1/(m²·s²)"}


def test_a_single_axis_keeps_what_acts_on_it() -> None:
    observer = Observer(device(1), ObserverSettings(effects={"cubic_stiffness": {}, "sense_cubic": {}}))
    assert observer.names[-2:] == ("k3x", "a3x")


@pytest.mark.parametrize(
    ("effects", "axes", "complaint"),
    [
        ({"cubic": {}}, 2, "no effect 'cubic'"),
        ({"cubic_stiffness": {"k4": 1.0}}, 2, "no coefficient k4; known: k3x, k3y"),
        ({"nonreciprocal_stiffness": {}}, 1, "needs two axes"),
    ],
)
def test_what_has_no_meaning_is_refused(effects: dict[str, dict[str, float]], axes: int, complaint: str) -> None:
    with pytest.raises(ModelError, match=complaint):
        Observer(device(axes), ObserverSettings(effects=effects))


def test_names_and_symbols_are_unique() -> None:
    symbols = [coefficient.name for effect in EFFECTS for coefficient in effect.coefficients]
    assert len(set(symbols)) == len(symbols)
    assert len(set(names())) == len(names())


def test_the_committed_page_is_current() -> None:
    assert (Path(__file__).parents[2] / "docs" / "reference" / "effects.md").read_text() == page()
