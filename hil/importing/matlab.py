"""A MATLAB file (before 7.3, which is HDF5) as a source of columns: vectors, fields of structs, columns of matrices."""

import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.mapping import Name
from hil.importing.read_back import Exported, exported_in
from hil.importing.source import Selection, Source, Table, Values, Wanted, kept_rows, numbers
from hil.toml.reading import near_or_all

_PART = re.compile(r"([A-Za-z]\w*)((?:\([^()]*\)|\{[^{}]*\})*)")
_INDEX = re.compile(r"[({]([^(){}]*)[)}]")
_CAPTURE = "capture"
"""The struct in which the bench's own export has a record."""


def is_matlab(path: Path) -> bool:
    return path.suffix.lower() == ".mat"


class MatlabSource(Source):
    """The variables of a file; a column is called as MATLAB would have it: `t`, `log.signals.values(:,2)`."""

    kind = "a MATLAB file"

    def __init__(self, path: Path) -> None:
        self.path, self.called = path, str(path)
        self._roots: dict[str, Any] = {}
        self._columns: list[Values] = []
        self._expressions: list[str] = []
        self._there = self._shapes()
        if missing := missing_bytes(path):
            size = path.stat().st_size
            raise InputError(f"{path}: is cut: it has {size} bytes and declares {size + missing}; fetch it again")

    @property
    def names(self) -> Sequence[str]:
        """What may be asked for without a map: the fields of an export of the bench's own, else the variables."""
        if _CAPTURE in self._there and (fields := self._variable(_CAPTURE).dtype.names):
            return [f"{_CAPTURE}.{field}" for field in fields if field not in ("units", "about")]
        return list(self._there)

    @property
    def exported(self) -> Exported | None:
        """What the file says of itself, where it is an export of a capture."""
        if _CAPTURE not in self._there:
            return None
        struct = self._variable(_CAPTURE)
        if struct.size != 1 or not {"about", "units"} <= set(struct.dtype.names or ()):
            return None
        units = struct.flat[0]["units"]
        if units.size != 1 or not units.dtype.names:
            return None
        names = {name: f"{_CAPTURE}.{name}" for name in units.dtype.names}
        words = {name: "".join(np.ravel(units.flat[0][name])) for name in units.dtype.names}
        return exported_in("".join(np.ravel(struct.flat[0]["about"])), names, words)

    def locate(self, name: Name) -> int:
        """The column called so, read at once."""
        if isinstance(name, int):
            raise InputError(
                f"{self.path}: column = {name} is a position, and variables of MATLAB have none; "
                f"give a name: {', '.join(self._there)}"
            )
        if name not in self._expressions:
            self._columns.append(self._column(name))
            self._expressions.append(name)
        return self._expressions.index(name)

    def read(self, wanted: Sequence[Wanted], selection: Selection) -> Table:
        """Those columns; a row's number is its own, from 1."""
        used = [*(one.at for one in wanted), *selection.where]
        lengths = {self._expressions[index]: self._columns[index].size for index in used}
        if len(set(lengths.values())) != 1:
            told = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise InputError(f"{self.path}: vectors of unequal length ({told}); map vectors of one record")
        count = next(iter(lengths.values()))
        rows = kept_rows(self, {index: self._columns[index] for index in selection.where}, count, selection)
        columns = []
        for one in wanted:
            values = self._columns[one.at][rows]
            name = self._expressions[one.at]
            columns.append(values if one.is_time else numbers(self, values, rows + 1, name, selection.missing))
        return Table(columns, rows + 1, count)

    def place(self, row: int, column: str) -> str:
        return f"{self.path}: variable {column}: entry {row}"

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        from scipy.io import whosmat

        return {name: shape for name, shape, _ in self._told(lambda: whosmat(self.path))}

    def _variable(self, name: str) -> Any:
        from scipy.io import loadmat

        if name not in self._there:
            raise InputError(f"{self.path}: no variable {name!r}; {near_or_all(name, list(self._there))}")
        if name not in self._roots:
            self._roots[name] = self._told(lambda: loadmat(self.path, variable_names=[name]))[name]
        return self._roots[name]

    def _told(self, read: Any) -> Any:
        from scipy.io.matlab import MatReadError

        try:
            return read()
        except NotImplementedError:
            raise InputError(f"{self.path}: a MATLAB 7.3 file; save it with save(…, '-v7')") from None
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({(error.strerror or 'unreadable').lower()})") from None
        except (MatReadError, ValueError, TypeError, EOFError, KeyError):
            raise InputError(f"{self.path}: not a MATLAB file, or damaged; fetch it again") from None

    def _column(self, expression: str) -> Values:
        value: Any = None
        at, walked = 0, ""
        while at < len(expression):
            part = _PART.match(expression, at)
            if part is None or (part.end() < len(expression) and expression[part.end()] != "."):
                raise InputError(
                    f"{self.path}: {expression!r} is no name as MATLAB writes it, as log.signals.values(:,2)"
                )
            name, indices = part[1], _INDEX.findall(part[2])
            value = self._variable(name) if not walked else self._field(value, name, walked)
            walked = f"{walked}.{name}" if walked else name
            for index in indices:
                value = self._indexed(np.asarray(value), index, walked)
                walked += f"({index})"
            at = part.end() + 1
        return self._vector(np.asarray(value), expression)

    def _field(self, value: Any, name: str, walked: str) -> Any:
        value = np.asarray(value)
        while value.dtype == object and value.size == 1 and isinstance(value.flat[0], np.ndarray):
            value = value.flat[0]
        if not value.dtype.names:
            raise InputError(f"{self.path}: {walked} is no struct; give its name alone")
        if name not in value.dtype.names:
            raise InputError(
                f"{self.path}: no field {name!r} in {walked}; {near_or_all(name, list(value.dtype.names))}"
            )
        if value.size != 1:
            raise InputError(f"{self.path}: {walked} is {value.size} structs; give one of them, as {walked}(1).{name}")
        return value.flat[0][name]

    def _indexed(self, value: Values, index: str, walked: str) -> Any:
        parts = [part.strip() for part in index.split(",")]
        try:
            if len(parts) == 1:
                return value.ravel(order="F")[self._position(parts[0], value.size)]
            sizes = zip(parts, value.shape, strict=True)
            return value[tuple(slice(None) if part == ":" else self._position(part, size) for part, size in sizes)]
        except (ValueError, IndexError):
            raise InputError(f"{self.path}: {walked}({index}) is not there: {walked} is {_shape(value)}") from None

    @staticmethod
    def _position(part: str, size: int) -> Any:
        if part == ":":
            return slice(None)
        place = size if part == "end" else int(part)
        if not 1 <= place <= size:
            raise IndexError
        return place - 1

    def _vector(self, value: Values, expression: str) -> Values:
        while value.dtype == object and value.size == 1 and isinstance(value.flat[0], np.ndarray):
            value = np.asarray(value.flat[0])
        if value.dtype.names:
            fields = ", ".join(f"{expression}.{field}" for field in value.dtype.names)
            raise InputError(f"{self.path}: {expression} is a struct; give one of its fields: {fields}")
        if value.dtype == object and all(np.asarray(cell).dtype.kind == "U" for cell in value.flat):
            return np.array(["".join(np.asarray(cell).ravel()) for cell in value.flat], dtype=object)
        if value.dtype.kind == "U" and value.size > 1:
            return np.array([str(row).strip() for row in value.ravel()], dtype=object)
        if value.size != max(value.shape, default=0) or value.dtype.kind not in "fiub":
            raise InputError(f"{self.path}: variable {expression} {_no_vector(value, expression)}")
        return np.ravel(value)


def _no_vector(value: npt.NDArray[Any], expression: str) -> str:
    """What a variable is that is no vector of real numbers, and what to do."""
    if value.dtype.kind == "c":
        return "is complex; save its real part, its imaginary part or its magnitude as a variable"
    if value.dtype.kind == "U":
        return "is text; give a variable of numbers"
    if value.dtype == object and value.ndim == 0:  # SciPy's sparse matrices are no arrays
        return f"is sparse; save full({expression})"
    if value.dtype == object:
        return f"is a cell array; give one of its cells, as {expression}{{1}}"
    columns = value.ndim > 2 or value.shape[0] >= value.shape[-1]
    index = ",".join([":", *"1" * (value.ndim - 1)] if columns else ["1", ":"])
    return f"is {_shape(value)}; give one of its {'columns' if columns else 'rows'}, as {expression}({index})"


def _shape(value: npt.NDArray[Any]) -> str:
    return " by ".join(map(str, value.shape))


_HEADER_5, _TAG_5, _HEADER_4 = 128, 8, 20
_BYTES_4 = (8, 4, 4, 2, 2, 1)
"""Of a number, by the third digit of a matrix's type in version 4."""


def missing_bytes(path: Path) -> int:
    """How many of the declared bytes are missing, 0 where none is."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEADER_5)
        order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
        at = 0 if order is None else _HEADER_5
        while at < size:
            file.seek(at)
            read = file.read(_TAG_5 if order is not None else _HEADER_4)
            length = _length_4(read) if order is None else _length_5(read, order)
            at += len(read) + length
    return max(at - size, 0)


def _length_5(tag: bytes, order: str) -> int:
    """Bytes of an element behind its tag; of a cut tag what it lacks."""
    return int(struct.unpack(f"{order}II", tag)[1]) if len(tag) == _TAG_5 else _TAG_5 - len(tag)


def _length_4(head: bytes) -> int:
    if len(head) < _HEADER_4:
        return _HEADER_4 - len(head)
    order = "<" if 0 <= struct.unpack("<i", head[:4])[0] < 10_000 else ">"
    kind, rows, columns, imaginary, name = struct.unpack(f"{order}5i", head)
    of_number = _BYTES_4[min(kind // 10 % 10, len(_BYTES_4) - 1)]
    return max(int(rows * columns * of_number * (2 if imaginary == 1 else 1) + name), 0)
