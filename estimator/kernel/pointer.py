"""Calls of effects that were not there when the kernels were compiled: their number is the address of their function.

An effect of the catalogue is a branch of what was compiled with the kernels; one of a bench file or of another package
is compiled by itself (`estimator.kernel.own`) and reached through its address, so that a new one costs a second and not
the compilation of every kernel.
"""

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

LEAST_ADDRESS = 4096
"""No address is below it, and no number of the catalogue beyond."""

FORCE, SENSE = 0, 1
"""What is asked for: the first argument of the function behind an address."""

_NUMBERS: Any = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
OWN_SIGNATURE = types.int64(
    types.int64,  # FORCE or SENSE
    _NUMBERS,  # constants
    _NUMBERS,  # states, …
    types.int64,  # … so many numbers from one to the next
    _NUMBERS,  # drive
    _NUMBERS,  # signals
    types.int64,  # index of the first coefficient among the constants
    types.int64,  # of the first signal
    _NUMBERS,  # what to add to: values,
    _NUMBERS,  # derivatives by states,
    types.int64,  # so many numbers from one axis to the next
    _NUMBERS,  # derivatives by constants,
    types.int64,  # alike
)

_LONG = ir.IntType(64)
_POINTER = ir.DoubleType().as_pointer()
_FUNCTION = ir.FunctionType(
    _LONG,
    [_POINTER if argument == _NUMBERS else _LONG for argument in OWN_SIGNATURE.args],
)
Generator = Callable[[Any, Any, Any, Sequence[Any]], Any]


def _caller(what: int) -> Any:
    """Call the function at `address` for what it adds to force or sense; arguments as of a generated effect."""

    def call(
        typing: Any,
        address: Any,
        c: Any,
        s: Any,
        u: Any,
        w: Any,
        first: Any,
        signal: Any,
        value: Any,
        by_states: Any,
        by_constants: Any,
    ) -> tuple[Any, Generator]:
        whole = types.int64
        signature = types.void(whole, c, s, u, w, whole, whole, value, by_states, by_constants)

        def generate(context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> Any:
            def array(at: int) -> Any:
                return context.make_array(signature.args[at])(context, builder, arguments[at])

            def step(at: int) -> Any:
                """How many numbers lie from one entry of the first dimension to the next."""
                stride = builder.extract_value(array(at).strides, 0)
                return builder.sdiv(stride, _LONG(8))

            function = builder.inttoptr(arguments[0], _FUNCTION.as_pointer())
            builder.call(
                function,
                [
                    _LONG(what),
                    array(1).data,
                    array(2).data,
                    step(2),
                    array(3).data,
                    array(4).data,
                    arguments[5],
                    arguments[6],
                    array(7).data,
                    array(8).data,
                    step(8),
                    array(9).data,
                    step(9),
                ],
            )
            return context.get_dummy_value()

        return signature, generate

    return intrinsic(call)


call_force: Any = _caller(FORCE)
call_sense: Any = _caller(SENSE)
