"""What a call of the core takes, as one C structure: first counts, then arrays by their addresses, then numbers."""

import ctypes
from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray


class Arguments:
    """A structure of the core by the names of its fields, in the order of its declaration in C."""

    def __init__(self, counts: Sequence[str], arrays: Sequence[str], numbers: Sequence[str] = ()) -> None:
        self._arrays = frozenset(arrays)
        kinds = ((counts, ctypes.c_int64), (arrays, ctypes.c_void_p), (numbers, ctypes.c_double))
        fields = [(name, kind) for names, kind in kinds for name in names]
        self._structure = type("_Structure", (ctypes.Structure,), {"_fields_": fields})

    def __call__(self, **given: Any) -> Any:
        """A pointer to the structure; arrays that are not given are absent in C.  It keeps its arrays alive.

        Raises ValueError for an array that is not contiguous: what C wrote to a copy would be lost.
        """
        filled = self._structure(
            **{name: _address(value) if name in self._arrays else value for name, value in given.items()}
        )
        filled.kept = given
        return ctypes.pointer(filled)


def _address(array: NDArray[Any]) -> int:
    if not array.flags.c_contiguous:
        raise ValueError(f"an array of shape {array.shape} is not contiguous; copy it first")
    return int(array.ctypes.data)
