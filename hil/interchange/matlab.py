"""Read vectors from a MATLAB file (before 7.3, which is HDF5), and say where it goes wrong."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hil.errors import InputError
from hil.interchange.table import Table


def is_matlab(path: Path) -> bool:
    """Whether the name says that it is a MATLAB file."""
    return path.suffix.lower() == ".mat"


def read_vectors(path: Path, names: Sequence[str], rows: tuple[int, int] | None = None) -> Table:
    """The variables called `names` as columns; `rows` keeps [start, stop), counted from 0.

    The "line" of a row is its number from 1. Raises InputError for a file that is none, a variable that is absent or no
    vector of finite numbers, and vectors of unequal length.
    """
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatReadError

    try:
        there = {name: shape for name, shape, _ in whosmat(path)}
        wanted = loadmat(path, variable_names=list(names))
    except NotImplementedError:
        raise InputError(f"{path}: a MATLAB 7.3 file; save it with save(…, '-v7')") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({(error.strerror or 'unreadable').lower()})") from None
    except (MatReadError, ValueError, TypeError, EOFError):
        raise InputError(f"{path}: not a MATLAB file, or damaged; fetch it again") from None
    columns = []
    for name in names:
        if name not in there:
            raise InputError(f"{path}: no variable {name!r}; the file has: {', '.join(there)}")
        values = np.asarray(wanted[name])
        if values.size != max(values.shape, default=0) or values.dtype.kind not in "fiu":
            raise InputError(f"{path}: variable {name}: {values.shape} {values.dtype} is no vector of real numbers")
        column = np.ravel(values).astype(float)
        if not np.isfinite(column).all():
            raise InputError(f"{path}: variable {name}: entry {int(np.argmin(np.isfinite(column))) + 1} is not finite")
        columns.append(column)
    lengths = {name: len(column) for name, column in zip(names, columns, strict=True)}
    if len(set(lengths.values())) != 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InputError(f"{path}: vectors of unequal length ({told}); map vectors of one record")
    start, stop = rows or (0, None)
    kept = np.column_stack(columns)[start:stop]
    if not len(kept):
        raise InputError(f"{path}: no rows in [{start}, {stop}); correct `rows`")
    return Table(kept, np.arange(start, start + len(kept)) + 1)
