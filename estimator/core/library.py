"""The compiled core: of the libraries beside this file the one that suits the processor best.

Built when the package is installed (`compile_native.py`).  Arrays go by their addresses; the loader compares the sizes
of the rows that both sides lay out, so that one without the other cannot run.
"""

import ctypes
from pathlib import Path

from estimator.core.layout import BOARD, MEMORY, OUTPUT, SETTINGS, TRIMS
from estimator.core.variant import best, processor_flags

PATH = best(Path(__file__).parent, processor_flags())


def _load() -> tuple[ctypes.CDLL, int]:
    try:
        library = ctypes.CDLL(str(PATH))
    except OSError as error:
        raise ImportError(f"{PATH}: {error}; build it with `make install` or `python compile_native.py`") from error
    sizes = (ctypes.c_int64 * 6)()
    library.gyro_sizes(sizes)
    *rows, estimator = sizes
    ours = [row.itemsize for row in (SETTINGS, MEMORY, OUTPUT, TRIMS, BOARD)]
    if rows != ours:
        raise ImportError(f"{PATH}: rows of {rows} bytes, expected {ours}; build it with `make install`")
    library.gyro_observe_block.restype = ctypes.c_int64
    return library, estimator


LIBRARY, ESTIMATOR_BYTES = _load()
