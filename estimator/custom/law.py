"""A law as a SymPy expression in scaled units, put together node by node.

What has no derivative somewhere is smoothed there, below a billionth of the amplitude: an observer at rest must not
divide by its own velocity.
"""

from collections.abc import Mapping
from fractions import Fraction

import sympy as sp

from estimator.custom.grammar import Call, Name, Node, Number, Power, Product, Sum, names_in, told, walk
from estimator.custom.hyperbolic import tanh
from estimator.custom.names import ANGLES
from estimator.effects.declaration import Signal, Source
from estimator.errors import ModelError
from estimator.model.gyro import rate, ux, uy, vx, vy, x, y

SMOOTH = sp.Float(1e-18)
"""Square of the size below which |…| and √… are rounded off, scaled."""

DIRECTIONS = (sp.Symbol("direction_x"), sp.Symbol("direction_y"))
REST = sp.Symbol("v_rest")
"""Parameter of laws with sign(vx) or sign(vy): about as slow, the sign turns over."""

TURNOVER = sp.Float(0.01)  # of amplitude, ω0 and their products: below that, the sign of anything else does

_TIME, _TEMPERATURE = sp.Symbol("t"), sp.Symbol("T")
_FIXED = {
    "x": x,
    "y": y,
    "vx": vx,
    "vy": vy,
    "ux": ux,
    "uy": uy,
    "rate": rate,
    "t": _TIME,
    "T": _TEMPERATURE,
    "r": sp.sqrt(x**2 + y**2 + SMOOTH),
    "v": sp.sqrt(vx**2 + vy**2 + SMOOTH),
    "amplitude": sp.Integer(1),
    "omega0": sp.Integer(1),
}
# Twice the angle as a direction in the plane: cosine and sine, not of length 1.
_TWICE = {
    "orientation": (x**2 - y**2 + vx**2 - vy**2, 2 * (x * y + vx * vy)),
    "phase": (x**2 + y**2 - vx**2 - vy**2, -2 * (x * vx + y * vy)),
}
_PLAIN = {"sin": sp.sin, "cos": sp.cos, "tanh": tanh, "exp": sp.exp}


def expression(node: Node, own: Mapping[str, sp.Symbol]) -> sp.Expr:
    """The law in SymPy; own: symbols of its coefficients and parameters.

    Raises ModelError where it divides by what is always zero.
    """
    built = _built(node, own)
    if built.has(sp.zoo, sp.nan, sp.oo, sp.I):
        raise ModelError(f"{told(node)} divides by zero; change it")
    return built


def signals_in(node: Node) -> tuple[Signal, ...]:
    """The signals that a law depends on, but for its parameters."""
    found = [
        Signal(symbol, source)
        for name, symbol, source in (
            ("t", _TIME, Source.TIME),
            ("T", _TEMPERATURE, Source.TEMPERATURE),
        )
        if name in names_in(node)
    ]
    for axis, name in enumerate(("vx", "vy")):
        if any(part == Call("sign", Name(name)) for part in walk(node)):
            found.append(Signal(DIRECTIONS[axis], Source.DIRECTION, axis))
    return tuple(found)


def _built(node: Node, own: Mapping[str, sp.Symbol]) -> sp.Expr:
    match node:
        case Number(value=value):
            return sp.Integer(int(value)) if value.is_integer() and abs(value) < 1e9 else sp.Float(value)
        case Name(name=name):
            return own[name] if name in own else _FIXED[name]
        case Sum(left=left, right=right):
            return _built(left, own) + _built(right, own)
        case Product(left=left, right=right):
            return _built(left, own) * _built(right, own)
        case Power(base=base, exponent=exponent):
            return _power(_built(base, own), exponent)
        case Call(function=function, argument=Product(left=Number(value=times), right=Name(name=name))) if (
            name in ANGLES
        ):
            return _multiple(name, function, int(times))
        case Call(function=function, argument=argument):
            return _called(function, argument, _built(argument, own))
    raise ModelError(f"{told(node)} is no law")


def _called(function: str, argument: Node, inner: sp.Expr) -> sp.Expr:
    if function in _PLAIN:
        return _PLAIN[function](inner)
    if function == "sqrt":
        return _power(inner, Fraction(1, 2))
    if function == "abs":
        return sp.sqrt(inner**2 + SMOOTH)
    for axis, name in enumerate(("vx", "vy")):
        if argument == Name(name):
            return DIRECTIONS[axis]
    return tanh(inner / TURNOVER)


def _power(base: sp.Expr, exponent: Fraction) -> sp.Expr:
    """A root of what is below zero is that of zero."""
    if exponent.denominator == 1:
        return base ** sp.Integer(exponent.numerator)
    power = sp.Rational(exponent.numerator, exponent.denominator)
    if _never_negative(base):
        return base**power if _never_zero(base) else (base + SMOOTH) ** power
    return (sp.Piecewise((base, base > 0), (0, True)) + SMOOTH) ** power


def _never_zero(base: sp.Expr) -> bool:
    """Whether it was rounded off at zero already."""
    return base.is_Pow and base.exp == sp.Rational(1, 2) and SMOOTH in base.base.args


def _never_negative(base: sp.Expr) -> bool:
    if base.is_number:
        return bool(base >= 0)
    if base.is_Add:
        return all(_never_negative(part) for part in base.args)
    if base.is_Mul:
        return all(_never_negative(part) for part in base.args)
    return bool(base.is_Pow and (base.exp == sp.Rational(1, 2) or (base.exp.is_Integer and base.exp % 2 == 0)))


def _multiple(name: str, function: str, times: int) -> sp.Expr:
    """sin or cos of an even multiple of an angle of which twice is known as a direction."""
    cosine, sine = _TWICE[name]
    half = abs(times) // 2
    length = sp.sqrt(cosine**2 + sine**2 + SMOOTH)
    c, s = cosine / length, sine / length
    first = 0 if function == "cos" else 1
    sign = 1 if times > 0 or function == "cos" else -1
    parts = [(-1) ** (k // 2) * sp.binomial(half, k) * c ** (half - k) * s**k for k in range(first, half + 1, 2)]
    return sign * sp.Add(*parts)  # of (c + i s)ⁿ the real or the imaginary part
