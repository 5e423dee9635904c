"""Expressions as a declaration has them: put together without SymPy, which takes a third of a second to load, and
SymPy's own for those who calculate with them.
"""

import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

_Class = TypeVar("_Class", bound=type)
_OPERATORS: dict[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
    "negative": operator.neg,
    ">": operator.gt,
    "<": operator.lt,
}
_SYMBOL, _BRANCHES = "symbol", "Piecewise"
_BINDS = {"+": 1, "-": 1, "negative": 3, "*": 3, "/": 3, "**": 4}


def _operator(head: str, *, swapped: bool = False) -> Callable[["Formula", Any], "Formula"]:
    return lambda one, other: Formula(head, (other, one) if swapped else (one, other))


@dataclass(frozen=True)
class Formula:
    """One operation on formulas and numbers; SymPy takes it for what it stands for."""

    head: str
    parts: tuple[Any, ...]

    __add__, __radd__ = _operator("+"), _operator("+", swapped=True)
    __sub__, __rsub__ = _operator("-"), _operator("-", swapped=True)
    __mul__, __rmul__ = _operator("*"), _operator("*", swapped=True)
    __truediv__, __rtruediv__ = _operator("/"), _operator("/", swapped=True)
    __pow__, __gt__, __lt__ = _operator("**"), _operator(">"), _operator("<")

    def __neg__(self) -> "Formula":
        return Formula("negative", (self,))

    def __str__(self) -> str:
        return str(self.parts[0]) if self.head == _SYMBOL else str(self._sympy_())

    @property
    def name(self) -> str:
        """Of a symbol."""
        return str(self)

    def _sympy_(self) -> Any:
        return _in_sympy(self)


@cache
def symbol(name: str) -> Any:
    """The symbol of that name."""
    return Formula(_SYMBOL, (name,))


def symbols(names: str) -> Any:
    """Symbols of several names."""
    return tuple(symbol(name) for name in names.split())


def _function(head: str) -> Callable[[Any], Any]:
    return lambda value: Formula(head, (value,))


cos, exp, sin, sqrt, tanh = map(_function, ("cos", "exp", "sin", "sqrt", "tanh"))


def clipped(value: Any, limit: Any) -> Any:
    """`value` no further from zero than `limit`."""
    return Formula(_BRANCHES, ((limit, value > limit), (-limit, value < -limit), (value, True)))


def written(value: Any, outer: int = 0) -> str:
    """A formula as a reader expects it, in parentheses where `outer` binds as much as it does; clip(a, limit): a, no
    further from zero than the limit.
    """
    if not isinstance(value, Formula) or value.head == _SYMBOL:
        return str(value)
    if value.head == _BRANCHES:
        (limit, _), _, (clipped_value, _) = value.parts
        return f"clip({written(clipped_value)}, {written(limit)})"
    binds = _BINDS.get(value.head)
    if binds is None:
        return f"{value.head}({', '.join(written(part) for part in value.parts)})"
    if value.head == "negative":
        text = f"-{written(value.parts[0], binds)}"
    else:
        left, right = value.parts
        # Of equals the left one comes first; a power is no base of another, a sign stands behind no other.
        equal = value.head in "+*" and getattr(right, "head", "") != "negative"
        sign = f" {value.head} " if binds == 1 else value.head
        text = f"{written(left, binds - (binds < 4))}{sign}{written(right, binds - equal)}"
    return f"({text})" if binds <= outer else text


def names_in(value: Any) -> frozenset[str]:
    """Names of the symbols in a formula, or in an expression of SymPy's."""
    if isinstance(value, Formula) and value.head == _SYMBOL:
        return frozenset((str(value),))
    if isinstance(value, Formula | tuple):
        return frozenset().union(*map(names_in, value.parts if isinstance(value, Formula) else value))
    return frozenset(str(one) for one in getattr(value, "free_symbols", ()))


def is_nothing(value: Any) -> bool:
    """Whether it is the number 0."""
    return not isinstance(value, Formula) and bool(value == 0)


def without(value: Any, names: Collection[str]) -> Any:
    """What is left of a formula where the symbols of those names are 0."""
    if isinstance(value, tuple):
        return tuple(without(part, names) for part in value)
    if not isinstance(value, Formula):
        return value
    if value.head == _SYMBOL:
        return 0 if str(value) in names else value
    return _left(value.head, tuple(without(part, names) for part in value.parts))


def _left(head: str, parts: tuple[Any, ...]) -> Any:
    """An operation, done as far as zeros in it allow."""
    gone = [is_nothing(part) for part in parts]
    if head in ("sin", "tanh", "sqrt", "negative") and gone[0]:
        return 0
    if head in ("cos", "exp") and gone[0]:
        return 1
    if head == "*" and any(gone):
        return 0
    if head in ("/", "**") and gone[0]:
        return 0
    if head == "+" and any(gone):
        return parts[1] if gone[0] else parts[0]
    if head == "-" and any(gone):
        return parts[0] if gone[1] else _left("negative", parts[1:])
    if head in _OPERATORS and not any(isinstance(part, Formula) for part in parts):
        return _OPERATORS[head](*parts)
    return Formula(head, parts)


@cache
def _in_sympy(formula: Formula) -> Any:
    import sympy as sp

    if formula.head == _SYMBOL:
        return sp.Symbol(formula.parts[0])
    parts = [in_sympy(part) for part in formula.parts]
    if formula.head in _OPERATORS:
        return _OPERATORS[formula.head](*parts)
    return getattr(sp, formula.head)(*parts)


def in_sympy(value: Any) -> Any:
    """What SymPy calls it; of a tuple or a mapping, each part; None stays."""
    if value is None or value is True:
        return value
    if isinstance(value, tuple):
        return tuple(in_sympy(part) for part in value)
    if isinstance(value, Mapping):
        return {in_sympy(key): in_sympy(part) for key, part in value.items()}
    if isinstance(value, Formula):
        return _in_sympy(value)
    import sympy as sp

    return sp.sympify(value)


class _Symbolic:
    """An attribute that shows SymPy's expressions and holds what was declared."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type) -> Any:
        return self if instance is None else in_sympy(instance.__dict__[self._name])

    def __set__(self, instance: Any, value: Any) -> None:
        instance.__dict__[self._name] = value


def symbolic(*names: str) -> Callable[[_Class], _Class]:
    """Of a frozen dataclass: those fields may be declared as formulas, and show SymPy's expressions."""

    def decorated(declared: _Class) -> _Class:
        for name in names:
            setattr(declared, name, _Symbolic(name))
        return declared

    return decorated


def as_declared(instance: Any, name: str) -> Any:
    """A symbolic field as it was declared, without SymPy."""
    return instance.__dict__[name]
