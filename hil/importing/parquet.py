"""A Parquet file as a source of columns; those that are asked for are read, the others may hold anything."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from hil.errors import InputError
from hil.importing.mapping import Name
from hil.importing.read_back import Exported, exported_in
from hil.importing.source import Selection, Source, Table, Values, Wanted, kept_rows, numbers, position
from hil.importing.time_column import of_arrow
from hil.records.capture import Hold
from hil.records.layout import HEADER_KEY

_MAGIC = b"PAR1"


def is_parquet(source: Path) -> bool:
    try:
        with source.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


class ParquetSource(Source):
    """The columns of a file; a field of a struct is called `struct.field`."""

    kind = "a Parquet file"

    def __init__(self, path: Path) -> None:
        self.path, self.called = path, str(path)
        self._schema = schema = self._told(lambda pq: pq.ParquetFile(path).schema_arrow)
        self.metadata: Mapping[bytes, bytes] = schema.metadata or {}
        self._leaves = [leaf for field in schema for leaf in _leaves(field, field.name)]
        self._columns = [at for at, field in enumerate(schema) for _ in _leaves(field, field.name)]
        """of each leaf the position of its column"""

    @property
    def names(self) -> Sequence[str]:
        """The columns, fields of structs among them."""
        return [name for name, _ in self._leaves]

    @property
    def hold(self) -> Hold:
        """What the drive does between samples, as an export says; zoh where the file says nothing."""
        try:
            told = json.loads(self.metadata.get(HEADER_KEY, b"{}")).get("hold")
        except (ValueError, AttributeError, RecursionError):
            told = None
        return next((hold for hold in get_args(Hold) if hold == told), "zoh")

    @property
    def exported(self) -> Exported | None:
        """What the file says of itself, where it is an export of a capture."""
        units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in self._schema}
        return exported_in(self.metadata.get(HEADER_KEY, b""), {name: name for name in self.names}, units)

    def locate(self, name: Name) -> int:
        """The position of a leaf from 0. A position in a map counts columns, of which a struct is one."""
        columns = self._schema.names
        if isinstance(name, int) or (name in columns and name not in self.names):
            at = position(name, columns, self.called)
            if columns[at] not in self.names:
                fields = ", ".join(self.names[leaf] for leaf, column in enumerate(self._columns) if column == at)
                what = f"column {name} is the struct {columns[at]}" if isinstance(name, int) else f"{name} is a struct"
                raise InputError(f"{self.called}: {what}; give one of its fields: {fields or 'it has none'}")
            return self._columns.index(at)
        if self.names.count(name) > 1 and name in columns:
            position(name, columns, self.called)  # raises, with the positions of columns
        return position(name, self.names, self.called)

    def read(self, wanted: Sequence[Wanted], selection: Selection) -> Table:
        """Those columns; a row's number counts from 0."""
        import pyarrow as pa

        arrays: dict[int, Any] = self._told(lambda pq: self._arrays(pq, [one.at for one in wanted], selection))
        count = len(next(iter(arrays.values())))
        where = {index: np.asarray(arrays[index].to_numpy(zero_copy_only=False)) for index in selection.where}
        rows = kept_rows(self, where, count, selection)
        columns: list[Values] = []
        for one in wanted:
            array = arrays[one.at]
            kind = array.type
            if one.is_time and not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
                columns.append(self._time(array, one)[rows])
                continue
            if pa.types.is_decimal(kind):
                array, kind = array.cast(pa.float64(), safe=False), pa.float64()
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
                called = f"{self.path}: column {self.names[one.at]}"
                raise InputError(f"{called}: {kind} is no number; map another column, or write it as numbers")
            values = np.asarray(array.to_numpy(zero_copy_only=False))[rows]
            if one.is_time:
                columns.append(values)
            else:
                columns.append(numbers(self, values, rows, self.names[one.at], selection.missing))
        return Table(columns, rows, count)

    def place(self, row: int, column: str) -> str:
        return f"{self.path}: column {column}: row {row}"

    def _time(self, array: Any, one: Wanted) -> Values:
        import pyarrow as pa

        if pa.types.is_string(array.type) or pa.types.is_large_string(array.type):
            return np.array(["" if text is None else text for text in array.to_pylist()], dtype=object)
        try:
            return of_arrow(array)
        except ValueError as error:
            raise InputError(f"{self.path}: column {self.names[one.at]}: {error}; map another column") from None

    def _arrays(self, pq: Any, indices: Sequence[int], selection: Selection) -> dict[int, Any]:
        """Leaves by position, each as one array."""
        import pyarrow.compute as pc

        used = list(dict.fromkeys([*indices, *selection.where]))
        with pq.ParquetFile(self.path) as file:
            table = file.read(columns=[self._leaves[index][0] for index in used])
            arrays = {}
            for index in used:
                name = self._leaves[index][0]
                top = self._schema.names[self._columns[index]]
                same = [at for at, other in enumerate(self._schema.names) if other == top]
                parts = [top, *(name.removeprefix(top + ".").split(".") if name != top else ())]
                read = table.schema.get_all_field_indices(top)
                column = table.column(read[same.index(self._columns[index])]).combine_chunks()
                for part in parts[1:]:
                    column = pc.struct_field(column, part)
                column = column.combine_chunks() if hasattr(column, "combine_chunks") else column
                arrays[index] = column.dictionary_decode() if hasattr(column, "dictionary_decode") else column
        return arrays

    def _told(self, read: Any) -> Any:
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            return read(pq)
        except (pa.ArrowException, OSError, MemoryError, OverflowError):
            raise InputError(f"{self.path}: no Parquet file that can be read; export it anew") from None


def _leaves(field: Any, name: str) -> list[tuple[str, Any]]:
    import pyarrow as pa

    if not pa.types.is_struct(field.type):
        return [(name, field.type)]
    return [leaf for inner in field.type for leaf in _leaves(inner, f"{name}.{inner.name}")]
