"""The little language of a law: numbers, names, + − * / **, and a few functions of one argument.

Text is read into a tree of Python's `ast` and from there, node by node, into the tree below; what is not listed here is
refused.  Nothing is ever evaluated as Python.  Length, depth and exponents are bounded, so that no text takes long.
"""

import ast
import math
import re
import unicodedata
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from estimator.errors import ModelError

LONGEST = 500  # characters
DEEPEST = 30
LARGEST_EXPONENT = 12
LARGEST_DEGREE = 24
FUNCTIONS = ("sin", "cos", "tanh", "exp", "sqrt", "sign", "abs")

_REMEDIES = {
    "^": "write ** for a power",
    "|": "write v for the speed, r for the radius, abs(…) for any other",
    "=": "give the right-hand side only",
    ",": "a function has one argument; write 0.5 for a half",
    "²": "write **2",
    "³": "write **3",
    "·": "write * for a product",
    "×": "write * for a product",
    "−": "write - for a minus",
}
_ALLOWED = re.compile(r"[A-Za-z0-9_.+\-*/() \t\n]")


@dataclass(frozen=True)
class Number:
    """A finite number."""

    value: float


@dataclass(frozen=True)
class Name:
    """A state, a drive, a coefficient, …: what it is, is not the grammar's to know."""

    name: str


@dataclass(frozen=True)
class Sum:
    """left + right."""

    left: "Node"
    right: "Node"


@dataclass(frozen=True)
class Product:
    """left · right."""

    left: "Node"
    right: "Node"


@dataclass(frozen=True)
class Power:
    """base to an exponent that is a number."""

    base: "Node"
    exponent: Fraction


@dataclass(frozen=True)
class Call:
    """One of FUNCTIONS of one argument."""

    function: str
    argument: "Node"


Node = Number | Name | Sum | Product | Power | Call
MINUS_ONE = Number(-1.0)


def parsed(text: str) -> Node:
    """The tree of a law.

    Raises ModelError, one line that names the place and the remedy, for whatever is more than arithmetic.
    """
    if len(text) > LONGEST:
        raise ModelError(f"{len(text)} characters; a law has at most {LONGEST}: split it into several effects")
    if not text.strip():
        raise ModelError("empty; give a law such as -k5 * x * r**4, or leave the key out")
    for place, character in enumerate(text):
        if not _ALLOWED.match(character):
            raise ModelError(f"{_shown(character)} at character {place + 1}; {_remedy(character)}")
    flat = " ".join(text.split())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(flat, mode="eval")
    except SyntaxError as error:
        place = min(max(error.offset or 1, 1), len(flat))
        raise ModelError(
            f"no arithmetic at character {place}, {_around(flat, place)}; check signs and parentheses"
        ) from None
    except (RecursionError, MemoryError, ValueError):
        raise ModelError(f"nested too deeply; a law is at most {DEEPEST} deep") from None
    node = _Reader(flat).read(tree.body, 1)
    if (degree := _degree(node)) > LARGEST_DEGREE:
        raise ModelError(
            f"of degree {float(degree):g}; a law has a degree of {LARGEST_DEGREE} at most: lower its exponents"
        )
    return node


def names_in(node: Node) -> frozenset[str]:
    """All names in a tree."""
    return frozenset(part.name for part in walk(node) if isinstance(part, Name))


def walk(node: Node) -> Iterator[Node]:
    """A tree's nodes, the whole first."""
    yield node
    for part in _parts(node):
        yield from walk(part)


def constant(node: Node) -> float | None:
    """The value of a tree without names, None of others."""
    return node.value if isinstance(node, Number) else None


def terms(node: Node) -> tuple[Node, ...]:
    """What a sum adds up."""
    return (*terms(node.left), *terms(node.right)) if isinstance(node, Sum) else (node,)


def factors(node: Node) -> tuple[tuple[Node, Fraction], ...]:
    """What a product multiplies, each with its exponent."""
    if isinstance(node, Product):
        return (*factors(node.left), *factors(node.right))
    if isinstance(node, Power):
        return tuple((base, power * node.exponent) for base, power in factors(node.base))
    return ((node, Fraction(1)),)


def told(node: Node) -> str:
    """A tree as text, short enough for a message."""
    text = _told(node)
    return text if len(text) <= 40 else text[:37] + "…"


class _Reader:
    """From Python's tree to ours."""

    def __init__(self, text: str) -> None:
        self.text = text

    def read(self, node: ast.expr, depth: int) -> Node:
        if depth > DEEPEST:
            raise ModelError(f"nested more than {DEEPEST} deep; write it flatter")
        match node:
            case ast.Constant(value=value):
                return self._number(node, value)
            case ast.Name(id=name) if not name.startswith("_"):
                return Name(name)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.read(operand, depth + 1)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _folded(Product(MINUS_ONE, self.read(operand, depth + 1)))
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return _folded(Power(self.read(left, depth + 1), self._exponent(right)))
            case ast.BinOp(left=left, op=op, right=right):
                return _folded(self._joined(node, self.read(left, depth + 1), op, self.read(right, depth + 1)))
            case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]) if function in FUNCTIONS:
                if isinstance(argument, ast.Starred):
                    raise self._refused(argument)
                return _folded(Call(function, self.read(argument, depth + 1)))
            case ast.Call(func=ast.Name(id=function)):
                what = "has one argument" if function in FUNCTIONS else "is no function here"
                raise ModelError(f"{_shown(function)} {what}; known: {', '.join(FUNCTIONS)}, of one argument each")
        raise self._refused(node)

    def _joined(self, node: ast.expr, left: Node, op: ast.operator, right: Node) -> Node:
        match op:
            case ast.Add():
                return Sum(left, right)
            case ast.Sub():
                return Sum(left, _folded(Product(MINUS_ONE, right)))
            case ast.Mult():
                return Product(left, right)
            case ast.Div():
                return Product(left, _folded(Power(right, Fraction(-1))))
        raise self._refused(node)

    def _number(self, node: ast.expr, value: object) -> Node:
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise self._refused(node)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ModelError(f"{self._source(node)} is no finite number; give a smaller one")
        return Number(number)

    def _exponent(self, node: ast.expr) -> Fraction:
        sign = 1
        while isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
            sign = -sign if isinstance(node.op, ast.USub) else sign
            node = node.operand
        match node:
            case ast.Constant(value=value) if type(value) in (int, float):
                number = self._number(node, value)
            case ast.BinOp(left=ast.Constant(), op=ast.Div(), right=ast.Constant()):
                number = self.read(node, 1)
            case _:
                raise ModelError(
                    f"exponent {self._source(node)}: no number; an exponent is a number up to {LARGEST_EXPONENT}"
                )
        if not isinstance(number, Number) or abs(number.value) > LARGEST_EXPONENT:
            raise ModelError(f"exponent {self._source(node)}: too large; give at most {LARGEST_EXPONENT}")
        return sign * Fraction(number.value).limit_denominator(1000)

    def _refused(self, node: ast.AST) -> ModelError:
        remedy = f"a law has numbers, names, + - * / **, parentheses and {', '.join(FUNCTIONS)} only"
        return ModelError(f"{self._source(node)} is more than arithmetic; {remedy}")

    def _source(self, node: ast.AST) -> str:
        return _shown(ast.get_source_segment(self.text, node) or type(node).__name__)


def _folded(node: Node) -> Node:
    """The tree, or its value where it has no names."""
    values = [constant(part) for part in _parts(node)]
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return node
    try:
        number = _value(node, known)
    except (OverflowError, ZeroDivisionError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ModelError(f"{told(node)} is no finite number; change it")
    return Number(number)


def _value(node: Node, parts: list[float]) -> float:
    match node:
        case Sum():
            return parts[0] + parts[1]
        case Product():
            return parts[0] * parts[1]
        case Power(exponent=exponent):
            return math.pow(parts[0], float(exponent))
        case Call(function="sign"):
            return math.copysign(1.0, parts[0]) if parts[0] else 0.0
        case Call(function="abs"):
            return abs(parts[0])
        case Call(function=function):
            return float(getattr(math, function)(parts[0]))
    raise ModelError(f"{told(node)} has no value")


def _parts(node: Node) -> tuple[Node, ...]:
    match node:
        case Sum(left=left, right=right) | Product(left=left, right=right):
            return left, right
        case Power(base=base):
            return (base,)
        case Call(argument=argument):
            return (argument,)
    return ()


def _degree(node: Node) -> Fraction:
    """How often names are multiplied at most."""
    match node:
        case Name():
            return Fraction(1)
        case Product(left=left, right=right):
            return _degree(left) + _degree(right)
        case Power(base=base, exponent=exponent):
            return _degree(base) * max(abs(exponent), Fraction(1))
    return max((_degree(part) for part in _parts(node)), default=Fraction(0))


def _told(node: Node) -> str:
    match node:
        case Number(value=value):
            return f"{value:g}"
        case Name(name=name):
            return name
        case Sum(left=left, right=right):
            return f"({_told(left)} + {_told(right)})"
        case Product(left=Number(value=-1.0), right=right):
            return f"-{_told(right)}"
        case Product(left=left, right=right):
            return f"{_told(left)} * {_told(right)}"
        case Power(base=base, exponent=exponent):
            return f"{_told(base)}**{float(exponent):g}"
        case Call(function=function, argument=argument):
            return f"{function}({_told(argument)})"


def _remedy(character: str) -> str:
    if character in _REMEDIES:
        return _REMEDIES[character]
    if character.isalpha():  # one that looks like a letter of ASCII is none
        return f"that is {unicodedata.name(character, 'no letter of ASCII')}; type the letters a to z"
    return "a law has numbers, names, + - * / ** and parentheses only"


def _shown(text: str) -> str:
    """A piece of the text as part of a message: short, and nothing in it that a terminal would obey."""
    short = text if len(text) <= 40 else text[:37] + "…"
    return ascii(short) if not short.isprintable() else f"'{short}'"


def _around(text: str, place: int) -> str:
    return f"near {_shown(text[max(place - 10, 0) : place + 10])}"
