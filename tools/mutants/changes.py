"""Small changes to a module's source, each a way to be wrong: a comparison turned, a sign, a bound, a promise left out.

Messages, types (annotations, and what stands in a `Literal`) and assertions (an assert, and `strict` of a zip, which
asserts equal lengths) stay as they are.
"""

import ast
import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

_TURNED: dict[type, type] = {
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.GtE,
    ast.GtE: ast.LtE,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_BOUND: dict[type, type] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_SWAPPED: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
_OTHER_NAME = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum"}
_NEUTRAL = {"str": '""', "bool": "False", "int": "0", "float": "0.0", "bytes": 'b""', "list": "[]", "dict": "{}"}


@dataclass(frozen=True)
class Mutant:
    """One change: the line it is on, what stood there and what stands there now; `make` writes the whole module."""

    line: int
    before: str
    after: str
    make: Callable[[], str]

    @property
    def source(self) -> str:
        """The whole module with it."""
        return self.make()

    @property
    def words(self) -> str:
        """Both, on one line."""
        return f"{_short(self.before)}  →  {_short(self.after)}"


def mutants(source: str) -> list[Mutant]:
    """Every change that can be made to a module, in the order of its lines."""
    tree = ast.parse(source)
    made = []
    for place, statement in enumerate(tree.body):
        for number in range(len(list(_edits(_alone(statement))))):
            changed = _alone(copy.deepcopy(statement))
            shown, edit = list(_edits(changed))[number]
            before = ast.unparse(shown)
            edit()
            after = ast.unparse(shown)
            if after != before:
                make = partial(_written, tree, place, changed.body[0])
                made.append(Mutant(shown.lineno, before, after, make))
    return sorted(made, key=lambda mutant: mutant.line)


def _alone(statement: ast.stmt) -> ast.Module:
    return ast.Module([statement], [])


def _written(tree: ast.Module, place: int, changed: ast.stmt) -> str:
    body = [*tree.body[:place], changed, *tree.body[place + 1 :]]
    return ast.unparse(ast.fix_missing_locations(ast.Module(body, [])))


def _edits(tree: ast.Module) -> Iterator[tuple[ast.stmt | ast.expr, Callable[[], None]]]:
    """What is shown of each change, and what makes it in the tree."""
    for node in _open_to_change(tree):
        match node:
            case ast.Compare(ops=[op]):
                for table in (_TURNED, _BOUND):
                    if other := table.get(type(op)):
                        yield node, lambda node=node, other=other: setattr(node, "ops", [other()])
            case ast.Compare(ops=ops):
                for place, op in enumerate(ops):
                    for table in (_TURNED, _BOUND):
                        if other := table.get(type(op)):
                            yield node, lambda ops=ops, place=place, other=other: ops.__setitem__(place, other())
            case ast.BinOp() | ast.BoolOp() | ast.AugAssign():
                if other := _SWAPPED.get(type(node.op)):
                    yield node, lambda node=node, other=other: setattr(node, "op", other())
            case ast.UnaryOp(op=ast.Not()):
                yield node, lambda node=node: setattr(node, "operand", ast.UnaryOp(ast.Not(), node.operand))
            case ast.UnaryOp(op=ast.USub()):
                yield node, lambda node=node: setattr(node, "op", ast.UAdd())
            case ast.Call(func=ast.Name() | ast.Attribute()):
                field = "id" if isinstance(node.func, ast.Name) else "attr"
                if other_name := _OTHER_NAME.get(getattr(node.func, field)):
                    yield node, lambda node=node, field=field, name=other_name: setattr(node.func, field, name)
            case ast.Constant(value=bool()):
                yield node, lambda node=node: setattr(node, "value", not node.value)
            case ast.Constant(value=int() | float() as number):
                for value in (1, 0) if number in (0, 1) else (2 * number, 0):
                    if value != number:
                        yield node, lambda node=node, value=value: setattr(node, "value", type(node.value)(value))
            case ast.FunctionDef():
                first = next((item for item in node.body if not _is_words(item)), None)
                early = ast.parse(f"return {_neutral(node.returns)}").body[0]
                if first is not None and not _does_nothing(first, early):
                    shown = ast.Expr(ast.Constant(f"def {node.name}"), lineno=node.lineno)
                    yield shown, lambda node=node, early=early, shown=shown: _return_early(node, early, shown)
            case ast.Expr(value=ast.Call()):
                yield node, lambda node=node: setattr(node, "value", ast.Constant(...))


def _does_nothing(first: ast.stmt, early: ast.stmt) -> bool:
    """Whether it is the `...` of a protocol, which nothing runs, or returns at once what `early` does."""
    return ast.unparse(first) in ("...", "pass", "return", ast.unparse(early))


def _return_early(node: ast.FunctionDef, early: ast.stmt, shown: ast.Expr) -> None:
    node.body.insert(int(_is_words(node.body[0])), early)
    shown.value = ast.Constant(f"def {node.name}: {ast.unparse(early)}")


def _neutral(returns: ast.expr | None) -> str:
    """What a function returns that does nothing, as source."""
    match returns:
        case ast.Name(id=name):
            return _NEUTRAL.get(name, "None")
        case ast.Subscript(value=ast.Name(id=name)):
            return "()" if name == "tuple" else _NEUTRAL.get(name, "None")
        case _:
            return "None"


def _is_words(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _open_to_change(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes below that a change may be made to."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, ast.keyword) and item.arg == "strict":
                continue
            if isinstance(item, ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom | ast.arg):
                continue
            if isinstance(item, ast.Subscript) and ast.unparse(item.value) == "Literal":
                continue
            if isinstance(item, ast.If) and ast.unparse(item.test) == "TYPE_CHECKING":
                continue
            if isinstance(item, ast.AST):
                yield from _open_to_change(item)


def _short(words: str) -> str:
    line = " ".join(words.split())
    return line if len(line) <= 110 else line[:107] + "…"
