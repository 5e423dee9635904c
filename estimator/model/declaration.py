"""What a model is: named states and constants, a vector field linear in the states, a measurement.

A declaration is written for SymPy (`estimator.model.formula`), in *scaled* units (time by 1/ω0, length by the nominal
amplitude), see `estimator.scaling`.  `estimator.core.generate` turns it into the compiled step, `estimator.oracle`
evaluates it directly, and the report prints its equations, so that the physics stands in one readable place.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from estimator.model.formula import symbolic

if TYPE_CHECKING:
    import sympy as sp


class Quantity(Enum):
    """What a symbol measures; decides its SI unit and its scale (`estimator.scaling`)."""

    POSITION = "m"
    VELOCITY = "m/s"
    OFFSET = "V"
    RATE = "rad/s"
    STIFFNESS = "1/s²"
    DAMPING = "1/s"
    DRIVE_GAIN = "1"


@symbolic("symbol")
@dataclass(frozen=True)
class State:
    """A quantity that moves from sample to sample by the vector field."""

    symbol: "sp.Symbol"
    name: str
    quantity: Quantity


@symbolic("symbol", "jump")
@dataclass(frozen=True)
class Constant:
    """A quantity the observer models as constant (or as a slow random walk).

    `jump` says what a sudden unit change of the constant does to the states: a jump of the rate moves the velocities
    in the rotating frame (the Euler term Ω̇ seen as an impulse), so the random walk of Ω and the velocity noise are
    correlated.
    """

    symbol: "sp.Symbol"
    name: str
    quantity: Quantity
    jump: Mapping["sp.Symbol", "sp.Expr"] = field(default_factory=dict)


@symbolic("inputs", "field", "measurement")
@dataclass(frozen=True)
class Model:
    """States ṡ = f(s, c, u), constants c, measurement z = h(s, c).

    `sense_constants` enter only the measurement, `flow_constants` only the vector field; the full state vector is
    X = [states, sense_constants, flow_constants].  `field` must be linear in the states and inputs.
    """

    name: str
    axes: int
    states: tuple[State, ...]
    sense_constants: tuple[Constant, ...]
    flow_constants: tuple[Constant, ...]
    inputs: "tuple[sp.Symbol, ...]"
    field: "tuple[sp.Expr, ...]"
    measurement: "tuple[sp.Expr, ...]"

    @property
    def constants(self) -> tuple[Constant, ...]:
        """All constants in the order of the state vector."""
        return self.sense_constants + self.flow_constants

    @property
    def entries(self) -> tuple[State | Constant, ...]:
        """What the state vector X = [states, constants] holds."""
        return self.states + self.constants

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the whole state vector, X = [states, constants]."""
        return tuple(item.name for item in self.entries)

    def system_matrices(self) -> "tuple[sp.Matrix, sp.Matrix]":
        """M (states × states) and N (states × inputs) of ṡ = M(c) s + N(c) u."""
        import sympy as sp

        vector = sp.Matrix(self.field)
        m = vector.jacobian([state.symbol for state in self.states])
        n = vector.jacobian(list(self.inputs))
        return m, n
