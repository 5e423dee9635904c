"""Kernels as Python runs them, so that a change to one shows at once and not after minutes of compilation.

A function of a kernel is then itself; records give their fields as attributes, and numbers side by side are NumPy's.
It stands alone: processes load it by its path.
"""

import sys
from collections.abc import Callable
from functools import wraps
from types import ModuleType
from typing import Any

import numba
import numpy as np


def install() -> None:
    """From now on, in this process, for what is imported from here on."""
    settings: Any = numba
    settings.config.DISABLE_JIT = True
    settings.njit = interpreted
    sys.modules["estimator.kernel.lanes"] = _lanes()
    np.seterr(all="ignore")  # a division by zero gives infinity, as in a compiled kernel


def interpreted(*function: Callable[..., Any], **_: Any) -> Any:
    """In the place of `numba.njit`, with its settings or without."""
    if not function:
        return _interpreted
    return _interpreted(function[0])


def _interpreted(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def call(*given: Any) -> Any:
        return function(*(_readable(one) for one in given))

    return call


def _readable(given: Any) -> Any:
    """Records with attributes, numbers as compiled code divides them."""
    match given:
        case np.ndarray() if given.dtype.names is not None and not isinstance(given, np.recarray):
            return given.view(np.recarray)
        case np.void() if not isinstance(given, np.record):
            whole: Any = given.base
            assert whole.shape == (1,), "a record is looked at through an array of its own"
            return whole.view(np.recarray)[0]
        case float():
            return np.float64(given)
        case tuple() if hasattr(given, "_fields"):
            return type(given)(*(_readable(one) for one in given))
        case _:
            return given


def _lanes() -> ModuleType:
    """What `estimator.kernel.lanes` offers, on arrays."""
    module = ModuleType("estimator.kernel.lanes")

    def flat(array: Any) -> Any:
        assert array.flags.c_contiguous, "lanes are taken of contiguous arrays"
        return array.reshape(-1)

    def take(array: Any, at: int, count: int) -> Any:
        assert count % 4 == 0
        found = flat(array)[at : at + count]
        assert len(found) == count, "lanes beyond the end of an array"
        return found.copy()

    def put(array: Any, at: int, lanes: Any) -> None:
        there = flat(array)[at : at + len(lanes)]
        assert len(there) == len(lanes), "lanes beyond the end of an array"
        there[:] = lanes

    def put_columns(array: Any, at: int, *rows: Any) -> None:
        put(array, at, np.stack(rows).T.reshape(-1))

    def gather(numbers: Any) -> Any:
        return np.array(numbers, float)

    def lane(lanes: Any, at: int) -> Any:
        return lanes[at]

    for one in (take, put, put_columns, gather, lane):
        setattr(module, one.__name__, one)
    return module
