"""A model declaration as NumPy functions, by SymPy's own printer and without the code generator of the kernels."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

from estimator.model.catalogue import MODELS
from estimator.scaling import Array


class EvaluatedModel:
    """Numbers out of a declaration, in scaled units: s (states,), c (constants,), all arrays float64."""

    def __init__(self, number: int) -> None:
        model = MODELS[number]
        states = [state.symbol for state in model.states]
        constants = [constant.symbol for constant in model.constants]
        m, n = model.system_matrices()
        flowing = [constant.symbol for constant in model.flow_constants]
        measurement = sp.Matrix(model.measurement)
        self._matrices = _function([constants], [m, n])
        self._slopes = _function([constants], [[m.diff(c), n.diff(c)] for c in flowing])
        self._measurement = _function([states, constants], list(measurement))
        self._jacobian = _function([states, constants], measurement.jacobian(states + constants))
        self._jumps = _function(
            [states],
            [[constant.jump.get(state, sp.Integer(0)) for state in states] for constant in model.constants],
        )

    def matrices(self, c: Array) -> tuple[Array, Array]:
        """M (states, states) and N (states, inputs) of ṡ = M s + N u."""
        m, n = self._matrices(c)
        return np.asarray(m, dtype=float), np.asarray(n, dtype=float)

    def slopes(self, c: Array) -> list[tuple[Array, Array]]:
        """∂M/∂c and ∂N/∂c for each flow constant."""
        return [(np.asarray(m, dtype=float), np.asarray(n, dtype=float)) for m, n in self._slopes(c)]

    def measurement(self, s: Array, c: Array) -> Array:
        """Predicted measurement (axes,)."""
        return np.array(self._measurement(s, c), dtype=float)

    def jacobian(self, s: Array, c: Array) -> Array:
        """Derivative of the measurement by the whole state vector, (axes, states + constants)."""
        return np.array(self._jacobian(s, c), dtype=float)

    def jumps(self, s: Array) -> Array:
        """What a unit jump of each constant does to the states, (constants, states)."""
        return np.array(self._jumps(s), dtype=float)


def _function(arguments: list[list[sp.Symbol]], expression: Any) -> Callable[..., Any]:
    function: Callable[..., Any] = sp.lambdify(arguments, expression, modules="numpy")
    return function


@cache
def evaluated(number: int) -> EvaluatedModel:
    """The model of that number in the catalogue, made ready once."""
    return EvaluatedModel(number)
