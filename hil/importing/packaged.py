"""Formats that other packages read: entry points of the group `hil.importers`, called as the files' names end.

    [project.entry-points."hil.importers"]
    mf4 = "my_package.mf4:columns"

The function takes a path and returns the file's columns, arrays (n,) by name; the rest of an import is the bench's:
what the columns are (a map), time, gaps, units.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path

import numpy.typing as npt

from hil.errors import InputError
from hil.errors.input import loaded
from hil.importing.array_source import ArraySource
from hil.importing.source import Selection, Table, Wanted

GROUP = "hil.importers"

Reader = Callable[[Path], Mapping[str, npt.ArrayLike]]


class PackagedSource(ArraySource):
    """The columns that another package reads from a file.  Raises InputError where it cannot."""

    def __init__(self, path: Path, reader: Reader) -> None:
        self.kind = f"a {path.suffix} file"
        try:
            super().__init__(dict(reader(path)), str(path))
        except Exception as error:  # whatever another package does wrong
            raise InputError(f"{path}: the package that reads {path.suffix} files cannot: {error}") from error

    def read(self, wanted: Sequence[Wanted], selection: Selection) -> Table:
        """Those columns; errors name the file."""
        try:
            return super().read(wanted, selection)
        except InputError as error:
            told = str(error)
            raise InputError(told if told.startswith(self.called) else f"{self.called}: {told}") from None

    def place(self, row: int, column: str) -> str:
        """File, row from 1 and column."""
        return f"{self.called}: row {row + 1}: column {column}"


def endings() -> tuple[str, ...]:
    """How names of files end that packages read, with the dot."""
    return tuple(sorted({f".{one.name}" for one in entry_points(group=GROUP) if re.fullmatch("[a-z0-9]+", one.name)}))


def reader_of(path: Path) -> Reader | None:
    """Who reads files whose names end as this one's; None where no package does.

    Raises InputError for a package that cannot be loaded.
    """
    suffix = path.suffix.removeprefix(".")
    entry = next((one for one in entry_points(group=GROUP) if suffix and one.name == suffix), None)
    return None if entry is None else loaded(entry, str(path))
