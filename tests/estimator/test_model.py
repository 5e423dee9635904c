"""The declared model and its exact flow, against integrators and finite differences that know nothing of either."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.core import layout
from estimator.core.taylor import taylor_order
from estimator.errors import ModelError
from estimator.model.catalogue import MODELS, model_for
from estimator.observer import Observer
from estimator.oracle.evaluation import evaluated
from estimator.oracle.flow import backward
from estimator.oracle.flow import flow as oracle_flow
from estimator.settings import Device, ObserverSettings
from tests.estimator.flow_pieces import taylor
from tests.estimator.gyro_loop import Array, Truth, swing

GYRO, OSCILLATOR = 0, 1


def field(number: int, s: Array, c: Array, u: Array) -> list[float]:
    """Equation (2) with the centrifugal term, and the single axis, written out by hand."""
    if number == OSCILLATOR:
        x, v = s
        _, k, d, b = c
        return [v, b * u[0] - d * v - k * x]
    x, vx, y, vy = s
    _, _, rate, kxx, kyy, kxy, dxx, dyy, dxy = c
    return [
        vx,
        u[0] - dxx * vx - dxy * vy - kxx * x - kxy * y + 2 * rate * vy + rate**2 * x,
        vy,
        u[1] - dxy * vx - dyy * vy - kxy * x - kyy * y - 2 * rate * vx + rate**2 * y,
    ]


def some_case(number: int, degree: int, seed: int) -> tuple[Array, Array, Array]:
    """Random constants, states and drive polynomial in scaled units."""
    rng = np.random.default_rng(seed)
    if number == OSCILLATOR:
        c = np.array([0.1, 1.0, 0.02, 1.0]) * (1.0 + 0.3 * rng.uniform(-1, 1, 4))
    else:
        c = np.concatenate([[0.1, -0.1], [0.05], [1.1, 0.9, 0.1], [0.01, 0.02, 0.003]])
        c *= 1.0 + 0.3 * rng.uniform(-1, 1, 9)
    model = MODELS[number]
    return c, rng.standard_normal(len(model.states)), rng.standard_normal((model.axes, degree + 1))


def kernel_flow(number: int, c: Array, s: Array, u: Array, h: float) -> Array:
    """[state | ∂/∂s | ∂/∂flow constants] after one step of the compiled flow."""
    columns = 1 + len(s) + len(MODELS[number].flow_constants)
    out = np.zeros((len(s), columns))
    out[:, 0] = s
    out[:, 1 : 1 + len(s)] = np.eye(len(s))
    taylor(number, c, u, h, taylor_order(h) + u.shape[1] - 1, columns, out)
    return out


@pytest.mark.parametrize("degree", [0, 3, 7])
@pytest.mark.parametrize("h", [0.01, 0.314, 1.5, 6.0])
@pytest.mark.parametrize("number", [GYRO, OSCILLATOR])
def test_flow_is_that_of_an_integrator(number: int, h: float, degree: int) -> None:
    c, s, u = some_case(number, degree, seed=degree)
    powers = np.arange(degree + 1)
    reference = solve_ivp(
        lambda t, y: field(number, y, c, u @ (t / h) ** powers), (0.0, h), s, method="DOP853", rtol=1e-12, atol=1e-13
    ).y[:, -1]
    np.testing.assert_allclose(kernel_flow(number, c, s, u, h)[:, 0], reference, rtol=0, atol=2e-11)


@pytest.mark.parametrize("number", [GYRO, OSCILLATOR])
def test_jacobian_is_that_of_finite_differences(number: int) -> None:
    c, s, u = some_case(number, 2, seed=5)
    h, d = 0.7, 1e-6
    jacobian = kernel_flow(number, c, s, u, h)[:, 1:]
    sensing = len(MODELS[number].sense_constants)
    for column in range(jacobian.shape[1]):
        moved = []
        for sign in (1.0, -1.0):
            c1, s1 = c.copy(), s.copy()
            if column < len(s):
                s1[column] += sign * d
            else:
                c1[sensing + column - len(s)] += sign * d
            moved.append(kernel_flow(number, c1, s1, u, h)[:, 0])
        np.testing.assert_allclose(jacobian[:, column], (moved[0] - moved[1]) / (2 * d), rtol=0, atol=3e-9)


@pytest.mark.moderate
@pytest.mark.parametrize("number", [GYRO, OSCILLATOR])
def test_taylor_series_and_matrix_exponential_agree(number: int) -> None:
    c, s, u = some_case(number, 3, seed=8)
    value, transition, sensitivity = oracle_flow(evaluated(number), c, s, u, 0.9)
    expected = np.column_stack([value, transition, sensitivity])
    np.testing.assert_allclose(kernel_flow(number, c, s, u, 0.9), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("more", range(6))
@pytest.mark.parametrize("part", [1.0, 0.5, 0.07, -0.09])
@pytest.mark.parametrize("number", [GYRO, OSCILLATOR])
def test_part_of_an_interval_agrees_with_the_matrix_exponential(number: int, part: float, more: int) -> None:
    """With the order that the whole interval asks for; behind the rest those of effects, which nothing pushes."""
    c, s, u = some_case(number, 2, seed=10 + more)
    states, model = len(s), 1 + len(s) + len(MODELS[number].flow_constants)
    out = np.zeros((states, model + more))
    out[:, 0] = s
    out[:, 1:] = np.random.default_rng(more).standard_normal(out[:, 1:].shape)
    begun = out.copy()
    taylor(number, c, u, 0.5 * part, taylor_order(0.5) + 2, model + more, out)
    value, transition, sensitivity = oracle_flow(evaluated(number), c, s, u, 0.5 * part)
    expected = transition @ begun
    expected[:, 0] = value
    expected[:, 1 + states : model] += sensitivity
    np.testing.assert_allclose(out, expected, rtol=0, atol=2e-13)


def test_flow_can_be_run_backwards() -> None:
    c, s, u = some_case(GYRO, 3, seed=9)
    after = kernel_flow(GYRO, c, s, u, 0.9)[:, 0]
    np.testing.assert_allclose(backward(evaluated(GYRO), c, after, u, 0.9), s, atol=1e-13)


def test_the_flow_at_20_samples_a_cycle_does_not_bias_the_stiffness() -> None:
    """One RK4 step shifts the frequency by h⁴/120, the stiffness by twice that, 1.6e-4 at 20 a cycle."""
    h = 2 * np.pi / 20
    c = np.array([0.0, 1.0, 0.0, 1.0])
    state, u = np.array([1.0, 0.0]), np.zeros((1, 1))
    m = np.array([[0.0, 1.0], [-1.0, 0.0]])
    step = sum(np.linalg.matrix_power(h * m, n) / f for n, f in enumerate((1.0, 1.0, 2.0, 6.0, 24.0)))
    runge_kutta = state.copy()
    for _ in range(200):
        state = kernel_flow(OSCILLATOR, c, state, u, h)[:, 0]
        runge_kutta = step @ runge_kutta

    def stiffness_error(final: Array) -> float:
        return abs(2.0 * np.arctan2(final[1], final[0]) / (200 * h))

    assert stiffness_error(state) < 1e-12
    assert stiffness_error(runge_kutta) == pytest.approx(2 * h**4 / 120, rel=0.05)


@pytest.mark.parametrize("steps", [1, 12])
@pytest.mark.parametrize("rate", [4000.0, 4e5])
def test_long_intervals_and_steep_polynomials_keep_the_flow_exact(rate: float, steps: int) -> None:
    """The order of the series must follow the longest interval of a record and the degree of its drive."""
    truth = Truth(sample_rate=rate)
    observer = Observer(truth.device(), ObserverSettings())
    start = np.array([1e-4, 0.0, -5e-5, 0.02])
    observer.x[:4] = start / observer.factors[:4]
    c, h = observer.x[4:].copy(), np.full(3, steps / rate)
    u = np.random.default_rng(0).standard_normal((3, 2, 8)) * 50.0
    lost = np.full((3, 2), np.nan)
    found = observer.run(lost, u, step=h).state[-1, :4]
    state = start / observer.factors[:4]
    for m in range(3):
        state, _, _ = oracle_flow(evaluated(GYRO), c, state, u[m] / observer.scaling.drive, h[m] * truth.omega0)
    np.testing.assert_allclose(found / observer.factors[:4], state, rtol=0, atol=1e-12)


def test_an_interval_beyond_the_flow_is_refused() -> None:
    observer = Observer(Truth().device(), ObserverSettings())
    with pytest.raises(ModelError, match="fill gaps with rows of NaN"):
        observer.run(np.zeros((1, 2)), np.zeros((1, 2)), step=np.array([0.1]))


@pytest.mark.slow
def test_a_jump_of_the_rate_moves_the_velocities_as_a_steep_ramp_does() -> None:
    """Ω̇ has no place in a flow of constant Ω; the declared jump stands for its impulse."""
    jump = evaluated(GYRO).jumps(np.array([0.3, 0.0, -0.7, 0.0]))[layout.RATE]
    s = np.array([0.3, 0.0, -0.7, 0.0])
    swing(s, np.zeros(6), 0.0, 0.0, 0.0, 1e-3, 1e-6)
    np.testing.assert_allclose(s - [0.3, 0.0, -0.7, 0.0], 1e-3 * jump, atol=2e-9)


def test_kernel_indices_are_those_of_the_declaration() -> None:
    gyro = MODELS[GYRO]
    for constant in gyro.constants:
        assert getattr(layout, constant.name.upper()) == gyro.names.index(constant.name) - len(gyro.states)
    assert gyro.names[:4] == ("x", "vx", "y", "vy")
    assert MODELS[OSCILLATOR].names == ("x", "vx", "phi_x", "kxx", "dxx", "drive_gain_x")


def test_measurement_is_position_plus_offset() -> None:
    s, c = np.array([0.5, 9.0, -0.25, 9.0]), np.array([0.1, 0.2, *[9.0] * 7])
    np.testing.assert_allclose(evaluated(GYRO).measurement(s, c), [0.6, -0.05])
    expected = np.zeros((2, 13))
    expected[0, [0, 4]] = expected[1, [2, 5]] = 1.0
    np.testing.assert_array_equal(evaluated(GYRO).jacobian(s, c), expected)


def test_no_model_for_three_axes() -> None:
    with pytest.raises(ModelError, match="no model with 3 axes; known: 2, 1"):
        model_for(3)


def test_too_few_samples_a_cycle_are_refused_with_the_rate_that_would_do() -> None:
    device = Device(
        sample_rate=700.0,
        stiffness=((2 * np.pi * 200) ** 2,),
        damping=(1.0,),
        amplitude=1e-4,
        sense_gain=(1.0,),
        noise=(1e-3,),
    )
    with pytest.raises(ModelError, match=r"3.5 samples a cycle are too few; sample at 800 Hz or faster"):
        Observer(device, ObserverSettings())
