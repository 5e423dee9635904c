"""The flow of the linear part over one step and its sensitivities, by matrix exponentials.

The drive is a polynomial in normalised time τ = t/h.  Its monomials obey dτⁿ/dτ = n τⁿ⁻¹, so that state and monomials
together follow a homogeneous linear equation whose exponential is the exact flow (Van Loan, IEEE Trans. Automatic
Control 23(3), 1978).  The derivative by a constant is the upper right block of exp([[A, ∂A/∂c], [0, A]]).
"""

import numpy as np
from scipy.linalg import expm

from estimator.oracle.evaluation import EvaluatedModel
from estimator.scaling import Array


def flow(model: EvaluatedModel, c: Array, s: Array, u: Array, h: float) -> tuple[Array, Array, Array]:
    """New state (states,), ∂/∂s (states, states) and ∂/∂flow constants (states, flow constants) after a step h.

    c (constants,), s (states,), u (inputs, degree + 1); scaled units.
    """
    states = len(s)
    generator = _generator(*model.matrices(c), u, h)
    size = len(generator)
    start = np.zeros(size)
    start[:states] = s
    start[states] = 1.0  # τ⁰; the other monomials begin at zero
    transition = expm(generator)
    slopes = model.slopes(c)
    pairs = np.zeros((len(slopes), 2 * size, 2 * size))
    pairs[:, :size, :size] = pairs[:, size:, size:] = generator
    for pair, (m, n) in zip(pairs, slopes, strict=True):
        pair[:states, size : size + states] = h * m
        pair[:states, size + states :] = h * n @ u
    sensitivity = expm(pairs)[:, :states, size:] @ start
    return transition[:states] @ start, transition[:states, :states], sensitivity.T


def backward(model: EvaluatedModel, c: Array, s: Array, u: Array, h: float) -> Array:
    """The state (states,) from which a step h under the drive polynomial u leads to s."""
    states = len(s)
    transition = expm(_generator(*model.matrices(c), u, h))
    return np.asarray(np.linalg.solve(transition[:states, :states], s - transition[:states, states]))


def _generator(m: Array, n: Array, u: Array, h: float) -> Array:
    """d/dτ of [state, 1, τ, τ², …]."""
    states, degrees = len(m), u.shape[1]
    generator = np.zeros((states + degrees,) * 2)
    generator[:states, :states] = h * m
    generator[:states, states:] = h * n @ u
    generator[states:, states:] = np.diag(np.arange(1.0, degrees), -1)
    return generator
