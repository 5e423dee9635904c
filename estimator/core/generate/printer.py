"""SymPy's expressions as C for `real` numbers, common subexpressions first."""

import re
from collections.abc import Iterable, Mapping

import sympy as sp
from sympy.printing.c import C99CodePrinter

_MOST_PRODUCTS = 8
_FUNCTIONS = {"sin": "SIN", "cos": "COS", "tanh": "TANH", "exp": "EXP", "log": "LOG", "sqrt": "SQRT", "Abs": "FABS"}


class _Printer(C99CodePrinter):  # type: ignore[misc]  # SymPy has no types
    """Literals by the macro R, small powers as products, functions by the names of layout.h."""

    def _print_Float(self, number: sp.Float) -> str:
        return f"R({float(number)!r})"

    def _print_Integer(self, number: sp.Integer) -> str:
        return f"R({int(number)}.0)"

    _print_One = _print_Zero = _print_NegativeOne = _print_Integer

    def _print_Rational(self, number: sp.Rational) -> str:
        return f"(R({number.p}.0) / R({number.q}.0))"

    _print_Half = _print_Rational

    def _print_Pi(self, _: sp.Expr) -> str:
        return "PI"

    def _print_Pow(self, power: sp.Pow) -> str:
        base, exponent = power.args
        if exponent == -1:
            return f"R(1.0) / {self.parenthesize(base, 51)}"
        if exponent == sp.Rational(1, 2):
            return f"SQRT({self._print(base)})"
        if exponent.is_Integer and abs(int(exponent)) <= _MOST_PRODUCTS:
            product = " * ".join([self.parenthesize(base, 51)] * abs(int(exponent)))
            return f"({product})" if exponent > 0 else f"(R(1.0) / ({product}))"
        return f"POW({self._print(base)}, {self._print(exponent)})"

    def _print_Function(self, function: sp.Function) -> str:
        name = _FUNCTIONS.get(type(function).__name__)
        if name is None:
            raise NotImplementedError(f"{type(function).__name__}() cannot be written as C")
        return f"{name}({', '.join(self._print(argument) for argument in function.args)})"

    def _print_Heaviside(self, step: sp.Heaviside) -> str:
        return f"({self._print(step.args[0])} > R(0.0) ? R(1.0) : R(0.0))"

    _print_sin = _print_cos = _print_tanh = _print_exp = _print_log = _print_Abs = _print_Function


_PRINTER = _Printer()


def written(expression: sp.Expr) -> str:
    """One expression. Raises NotImplementedError for what C has no word for."""
    return str(_PRINTER.doprint(expression))


def free_symbols(expressions: Iterable[sp.Expr]) -> set[sp.Basic]:
    """The symbols in all of them."""
    return set().union(*(sp.sympify(e).free_symbols for e in expressions))


def _kind(expression: sp.Expr) -> str:
    """Of a name for it: what a condition says is no number."""
    return "int" if isinstance(expression, sp.logic.boolalg.Boolean) and not expression.is_Symbol else "real"


def assignments(pairs: Iterable[tuple[str, sp.Expr]], prefix: str) -> list[str]:
    """Lines that declare a name for each expression, common subexpressions first, as `prefix` and a number."""
    named = list(pairs)
    shared, reduced = sp.cse([e for _, e in named], symbols=sp.numbered_symbols(prefix))
    lines = [f"const {_kind(e)} {symbol} = {written(e)};" for symbol, e in shared]
    return lines + [f"{name} = {written(e)};" for (name, _), e in zip(named, reduced, strict=True)]


def names_in(arguments: str) -> str:
    """The names of what a function takes, as a call gives them on."""
    return ", ".join(re.findall(r"(\w+)(?:,|$)", arguments))


def loads(places: Mapping[sp.Symbol, str], used: set[sp.Basic]) -> list[str]:
    """Lines that give the symbols that are used the values at their places."""
    return [f"const real {symbol} = {place};" for symbol, place in places.items() if symbol in used]
