"""Numbers side by side, as a processor's vector registers hold them: a multiple of four, taken from flat arrays and put
into them, multiplied by scalars, added and subtracted.

Whether a compiler puts a loop over 13 numbers into vector registers is its own affair and changes with its version;
written with lanes it has no choice.  Where a processor has no registers that wide, LLVM takes as many as it needs.
"""

import operator
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.errors import TypingError
from numba.extending import intrinsic, models, overload, register_model

Generator = Callable[[Any, Any, Any, Sequence[Any]], Any]
_FOUR = ir.VectorType(ir.DoubleType(), 4)
_WORD = ir.IntType(32)
# A product may go into a sum without being rounded on its own, where the processor has an instruction for it.  As
# x·y + z and y·x + z round alike, what is symmetric stays so to the last bit.
_FUSED = ("contract",)


class Lanes(types.Type):
    """Type of `count` numbers side by side, a multiple of four."""

    def __init__(self, count: int) -> None:
        if count % 4 != 0:
            raise TypingError(f"{count} lanes; expected a multiple of 4")
        self.count = count
        self.fours = count // 4
        super().__init__(name=f"Lanes({count})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, lanes: Lanes) -> None:
        super().__init__(manager, lanes, ir.ArrayType(_FOUR, lanes.fours))


def _assembled(builder: Any, fours: Sequence[Any]) -> Any:
    out = ir.Constant(ir.ArrayType(_FOUR, len(fours)), ir.Undefined)
    for k, four in enumerate(fours):
        out = builder.insert_value(out, four, k)
    return out


def _shuffled(builder: Any, one: Any, other: Any, order: Sequence[int]) -> Any:
    return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(_WORD, 4), list(order)))


def _pointer(context: Any, builder: Any, kind: Any, array: Any, at: Any, further: int) -> Any:
    """Where array[at + further] lies; no bounds are checked, as nowhere in a kernel."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [builder.add(at, at.type(further))]), _FOUR.as_pointer())


def _take(typing: Any, array: Any, at: Any, count: Any) -> tuple[Any, Generator]:
    """array[at : at + count] of a flat array; count a literal."""
    lanes = Lanes(count.literal_value)

    def generate(context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> Any:
        fours = []
        for k in range(lanes.fours):
            fours.append(builder.load(_pointer(context, builder, signature.args[0], arguments[0], arguments[1], 4 * k)))
            fours[-1].align = 8
        return _assembled(builder, fours)

    return lanes(array, types.intp, count), generate


take: Any = intrinsic(prefer_literal=True)(_take)


def _put(typing: Any, array: Any, at: Any, lanes: Any) -> tuple[Any, Generator]:
    """array[at:] ← lanes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> Any:
        for k in range(lanes.fours):
            pointer = _pointer(context, builder, signature.args[0], arguments[0], arguments[1], 4 * k)
            builder.store(builder.extract_value(arguments[2], k), pointer).align = 8
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), generate


put: Any = intrinsic(_put)


def _put_columns(typing: Any, array: Any, at: Any, a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Generator]:
    """array[at:] ← the columns of the matrix with the rows a, b, c, d, one behind the other."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> Any:
        for k in range(a.fours):
            rows = [builder.extract_value(row, k) for row in arguments[2:]]
            even = [_shuffled(builder, rows[i], rows[i + 1], (0, 4, 2, 6)) for i in (0, 2)]
            odd = [_shuffled(builder, rows[i], rows[i + 1], (1, 5, 3, 7)) for i in (0, 2)]
            columns = [
                _shuffled(builder, pair[0], pair[1], half)
                for half in ((0, 1, 4, 5), (2, 3, 6, 7))
                for pair in (even, odd)
            ]
            for j, column in enumerate(columns):
                pointer = _pointer(context, builder, signature.args[0], arguments[0], arguments[1], 4 * (4 * k + j))
                builder.store(column, pointer).align = 8
        return context.get_dummy_value()

    return types.void(array, types.intp, a, a, a, a), generate


put_columns: Any = intrinsic(_put_columns)


def _gather(typing: Any, numbers: Any) -> tuple[Any, Generator]:
    """A tuple of floats as lanes."""
    lanes = Lanes(len(numbers))

    def generate(context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> Any:
        fours = []
        for k in range(lanes.fours):
            four = ir.Constant(_FOUR, ir.Undefined)
            for j in range(4):
                four = builder.insert_element(four, builder.extract_value(arguments[0], 4 * k + j), _WORD(j))
            fours.append(four)
        return _assembled(builder, fours)

    return lanes(types.UniTuple(types.float64, lanes.count)), generate


gather: Any = intrinsic(_gather)


def _lane(typing: Any, lanes: Any, at: Any) -> tuple[Any, Generator]:
    """One of the numbers; `at` a literal."""
    four, place = divmod(at.literal_value, 4)

    def generate(context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> Any:
        return builder.extract_element(builder.extract_value(arguments[0], four), _WORD(place))

    return types.float64(lanes, at), generate


lane: Any = intrinsic(prefer_literal=True)(_lane)


def _operation(instruction: str) -> Any:
    """Lanes with lanes or with a scalar, number by number."""

    def combine(typing: Any, one: Any, other: Any) -> tuple[Any, Generator]:
        lanes = one if isinstance(one, Lanes) else other

        def spread(builder: Any, kind: Any, value: Any) -> list[Any]:
            if isinstance(kind, Lanes):
                return [builder.extract_value(value, k) for k in range(lanes.fours)]
            first = builder.insert_element(ir.Constant(_FOUR, ir.Undefined), value, _WORD(0))
            return [_shuffled(builder, first, first, (0, 0, 0, 0))] * lanes.fours

        def generate(context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> Any:
            sides = [spread(builder, *side) for side in zip(signature.args, arguments, strict=True)]
            do = getattr(builder, instruction)
            return _assembled(builder, [do(*pair, flags=_FUSED) for pair in zip(*sides, strict=True)])

        return lanes(one, other), generate

    return intrinsic(combine)


_sum, _difference, _product = _operation("fadd"), _operation("fsub"), _operation("fmul")


@overload(operator.add, strict=False)
def _add(one: Any, other: Any) -> Any:
    if isinstance(one, Lanes) and one == other:
        return lambda one, other: _sum(one, other)
    return None


@overload(operator.sub, strict=False)
def _sub(one: Any, other: Any) -> Any:
    if isinstance(one, Lanes) and one == other:
        return lambda one, other: _difference(one, other)
    return None


@overload(operator.mul, strict=False)
def _mul(one: Any, other: Any) -> Any:
    if one == types.float64 and isinstance(other, Lanes):
        return lambda one, other: _product(one, other)
    return None
