"""What a call of the core takes, as the structure that its C text declares."""

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.core.declared import Header
from estimator.core.layout import NUMBERS


@cache
def header(name: str) -> Header:
    """A text of the core, with the numbers of layout.h."""
    return Header(Path(__file__).with_name(name), NUMBERS)


class Arguments:
    """A structure of the core: by the text that declares it, and its name."""

    def __init__(self, text: str, name: str) -> None:
        self._structure = type(name, (ctypes.Structure,), {"_fields_": header(text).fields(name)})

    def __call__(self, **given: Any) -> Any:
        """A pointer to the structure; arrays that are not given are absent in C.  It keeps its arrays alive.

        Raises ValueError for an array that is not contiguous: what C wrote to a copy would be lost.
        """
        filled = self._structure(
            **{name: _address(value) if isinstance(value, np.ndarray) else value for name, value in given.items()}
        )
        filled.kept = given
        return ctypes.pointer(filled)


def _address(array: NDArray[Any]) -> int:
    if not array.flags.c_contiguous:
        raise ValueError(f"an array of shape {array.shape} is not contiguous; copy it first")
    return int(array.ctypes.data)
