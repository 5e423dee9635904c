"""Whether a law comes out in the unit that it must have; where it does not, which unit its coefficient should have."""

from collections.abc import Collection, Mapping
from fractions import Fraction

from estimator.custom.grammar import Call, Name, Node, Number, Power, Product, Sum, factors, names_in, terms, told
from estimator.custom.names import ANGLES, QUANTITIES
from estimator.custom.unit import NUMBER, Unit
from estimator.errors import ModelError

_TURNING = ("sin", "cos")
_PLAIN = ("sin", "cos", "tanh", "exp")  # of a plain number


def require_unit(
    node: Node, targets: Mapping[Unit, str], units: Mapping[str, Unit], coefficients: Collection[str]
) -> Unit:
    """The unit of the law, one of `targets`, whose values say what it is then; units: of the coefficients and
    parameters, `coefficients` among them.

    Raises ModelError, one line: an unknown name, units that do not add up, a coefficient that needs another unit.
    """
    known = {**{name: quantity.unit for name, quantity in QUANTITIES.items()}, **units}
    if strange := sorted(names_in(node) - set(known)):
        raise ModelError(
            f"unknown name '{strange[0]}'; declare it under coefficients or parameters, or use {', '.join(QUANTITIES)}"
        )
    _require_angles(node)
    first = next(iter(targets))
    found: Unit | None = None
    for term in terms(node):
        unit = _unit(term, known, coefficients)
        if unit is None:
            continue
        target = found or (unit if unit in targets else first)
        if unit != target:
            raise ModelError(_remedy(term, unit, target, targets[target], known, coefficients))
        found = unit
    return found or first


def _unit(node: Node, known: Mapping[str, Unit], coefficients: Collection[str]) -> Unit | None:
    """Unit of a tree; None of zero, which has any."""
    match node:
        case Number(value=value):
            return None if value == 0.0 else NUMBER
        case Name(name=name):
            return known[name]
        case Sum():
            return _summed([(term, _unit(term, known, coefficients)) for term in terms(node)])
        case Product(left=left, right=right):
            one, other = _unit(left, known, coefficients), _unit(right, known, coefficients)
            return None if one is None or other is None else one * other
        case Power(base=base, exponent=exponent):
            unit = _unit(base, known, coefficients)
            return None if unit is None else unit**exponent
        case Call(function=function, argument=argument):
            unit = _unit(argument, known, coefficients)
            if function in _PLAIN:
                if unit is not None and unit != NUMBER:
                    raise ModelError(_plain(function, argument, unit, known, coefficients))
                return NUMBER
            if function == "sign":
                return NUMBER
            return unit ** Fraction(1, 2) if unit is not None and function == "sqrt" else unit
    raise ModelError(f"{told(node)} has no unit")


def _summed(parts: list[tuple[Node, Unit | None]]) -> Unit | None:
    """Unit of a sum within a law."""
    first: tuple[Node, Unit] | None = None
    for term, unit in parts:
        if unit is None:
            continue
        if first is None:
            first = term, unit
        elif unit != first[1]:
            raise ModelError(
                f"{told(first[0])} in {first[1]} and {told(term)} in {unit} cannot be added; {_even(first[1], unit)}"
            )
    return None if first is None else first[1]


def _even(*units: Unit) -> str:
    if NUMBER in units:
        return "divide by amplitude or omega0, or give the number as a coefficient with a unit"
    return "multiply one by amplitude, omega0 or a coefficient"


def _plain(function: str, argument: Node, unit: Unit, known: Mapping[str, Unit], coefficients: Collection[str]) -> str:
    if wanted := _wanted(argument, unit, NUMBER, known, coefficients):
        return f"{function}({told(argument)}): of a plain number, not of {unit}; {wanted}"
    return (
        f"{function}({told(argument)}): of a plain number, not of {unit}; divide it by amplitude, omega0 or a parameter"
    )


def _remedy(
    term: Node, unit: Unit, target: Unit, what: str, known: Mapping[str, Unit], coefficients: Collection[str]
) -> str:
    """Where a term is off: which unit the coefficient in it should have."""
    head = f"{told(term)} is in {unit}, {what} in {target}"
    if wanted := _wanted(term, unit, target, known, coefficients):
        return f"{head}; {wanted}"
    return f"{head}; it needs a factor in {target / unit}, a coefficient of that unit"


def _wanted(
    term: Node, unit: Unit, target: Unit, known: Mapping[str, Unit], coefficients: Collection[str]
) -> str | None:
    """Which unit the one coefficient among the factors should have."""
    own = [(base.name, power) for base, power in factors(term) if isinstance(base, Name) and base.name in coefficients]
    if len(own) != 1:
        return None
    (name, power), *_ = own
    right = known[name] * (target / unit) ** (1 / power)
    if not right.whole:
        return f"the unit of {name} would be {right}; divide by amplitude or omega0 until its powers are whole"
    return f"the unit of {name} should be {right}, not {known[name]}"


def _require_angles(node: Node) -> None:
    match node:
        case Call(function=function, argument=Product(left=Number(value=times), right=Name(name=name))) if (
            name in ANGLES and function in _TURNING and times != 0.0 and times % 2.0 == 0.0 and abs(times) <= 24.0
        ):
            return
        case Name(name=name) if name in ANGLES:
            raise ModelError(
                f"{name} is known but for half a turn; write it as sin(2*{name}), cos(4*{name}), …, even up to 24"
            )
        case Sum(left=left, right=right) | Product(left=left, right=right):
            _require_angles(left)
            _require_angles(right)
        case Power(base=base):
            _require_angles(base)
        case Call(argument=argument):
            _require_angles(argument)
