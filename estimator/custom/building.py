"""From a declaration to the effect that observers carry: scaled units, SymPy expressions, signals."""

from dataclasses import replace

import sympy as sp

from estimator.custom.declaration import PLAUSIBLE, SENSED, Declaration
from estimator.custom.dimension import require_unit
from estimator.custom.grammar import Node, names_in
from estimator.custom.law import DIRECTIONS, REST, expression, signals_in
from estimator.custom.names import QUANTITIES
from estimator.custom.unit import VOLT, Unit, unit_of
from estimator.effects.declaration import Coefficient, Compensation, Effect, Parameter, Signal, Source
from estimator.errors import ModelError
from estimator.model.catalogue import MODELS
from estimator.model.gyro import ux, uy
from estimator.scaling import Scaling

_TAKEN = {name for model in MODELS for name in model.names}


def built(declared: Declaration, scaling: Scaling, axes: int) -> Effect:
    """The effect of a declaration as observers carry it, on a device of that scaling.

    Raises ModelError where a single axis has not what its laws speak of.
    """
    laws = declared.laws()
    if axes == 1:
        _require_single(laws)
    for table in ("coefficients", "parameters"):
        if taken := sorted(_TAKEN & set(getattr(declared, table))):
            raise ModelError(f"{table}.{taken[0]}: the base model has a constant of that name; take another")
    units = {name: unit_of(one.unit) for name, one in declared.coefficients.items()}
    units |= {name: unit_of(one.unit) for name, one in declared.parameters.items()}
    symbols = {name: sp.Symbol(f"own_{name}") for name in units}  # no symbol of a model or of the generated code
    signals = _signals(laws, declared, symbols)
    rest = (Parameter(REST, REST.name, 1, -1, default=0.01),) if {s.symbol for s in signals} & set(DIRECTIONS) else ()
    force = tuple(_force(laws.get(f"force_{axis}"), symbols) for axis in "xy")
    sense = tuple(
        _sensed(laws.get(f"sense_{letter}"), symbols, declared, units, scaling, axis)
        for axis, letter in enumerate("xy"[:axes])
    )
    within = set().union(*(part.free_symbols for part in (*force, *sense)))
    if fallen := [name for name in declared.coefficients if symbols[name] not in within]:
        raise ModelError(f"coefficients.{fallen[0]}: falls out of the law, as what is multiplied by 0; change the law")
    driven = any({ux, uy} & part.free_symbols for part in force)
    return Effect(
        name=declared.name,
        title=declared.title or declared.name.replace("_", " ").capitalize(),
        coefficients=tuple(
            _coefficient(name, declared, symbols, units[name], scaling) for name in declared.coefficients
        ),
        source=declared.source,
        signature=declared.signature,
        compensation=Compensation.INVERT if driven else Compensation.CANCEL if any(force) else Compensation.MAP,
        force=(force[0], force[1]),
        sense=(sense[0], sense[1] if axes == 2 else sp.Integer(0)),
        parameters=rest
        + tuple(_parameter(name, declared, symbols, units[name], scaling) for name in declared.parameters),
        signals=signals,
        shown=declared.written(),
    )


def _require_single(laws: dict[str, Node]) -> None:
    for key, node in laws.items():
        if key.endswith("_y"):
            raise ModelError(f"{key}: the device has a single axis; leave it out")
        if absent := sorted(name for name in names_in(node) if name in QUANTITIES and not QUANTITIES[name].single):
            raise ModelError(f"{key}: a single axis has no '{absent[0]}'; leave it out")


def _signals(laws: dict[str, Node], declared: Declaration, symbols: dict[str, sp.Symbol]) -> tuple[Signal, ...]:
    found = {signal: None for node in laws.values() for signal in signals_in(node)}
    return (*found, *(Signal(symbols[name], Source.PARAMETER) for name in declared.parameters))


def _force(node: Node | None, symbols: dict[str, sp.Symbol]) -> sp.Expr:
    return sp.Integer(0) if node is None else expression(node, symbols)


def _sensed(
    node: Node | None,
    symbols: dict[str, sp.Symbol],
    declared: Declaration,
    units: dict[str, Unit],
    scaling: Scaling,
    axis: int,
) -> sp.Expr:
    """As a displacement; a voltage, of which a scaled unit is the amplitude's on x, by the gain of its own axis."""
    if node is None:
        return sp.Integer(0)
    law = expression(node, symbols)
    if require_unit(node, SENSED, units, declared.coefficients) != VOLT:
        return law
    gain = scaling.sense(axis) / abs(scaling.sense(0))
    return law * (sp.Integer(round(1.0 / gain)) if abs(gain) == 1.0 else sp.Float(1.0 / gain))


def _coefficient(
    name: str, declared: Declaration, symbols: dict[str, sp.Symbol], unit: Unit, scaling: Scaling
) -> Coefficient:
    one, (m, s, k, v) = declared.coefficients[name], _powers(unit, f"coefficients.{name}")
    bare = Coefficient(symbols[name], name, PLAUSIBLE, m, s, k, one.positive, v)
    return bare if one.plausible is None else replace(bare, plausible=one.plausible / scaling.coefficient(bare))


def _parameter(
    name: str, declared: Declaration, symbols: dict[str, sp.Symbol], unit: Unit, scaling: Scaling
) -> Parameter:
    one, (m, s, k, v) = declared.parameters[name], _powers(unit, f"parameters.{name}")
    bare = Parameter(symbols[name], name, m, s, kelvin=k, volt=v)
    factor = scaling.coefficient(bare)
    return replace(bare, default=one.value / factor, tried=tuple(value / factor for value in one.tried))


def _powers(unit: Unit, place: str) -> tuple[int, int, int, int]:
    if not unit.whole:
        raise ModelError(f"{place}.unit: {unit} has broken powers; divide by amplitude or omega0")
    m, s, k, v = (int(power) for power in unit.powers)
    return m, s, k, v
