"""`hil export`: what a run recorded and estimated, as CSV, Parquet, MAT or MCAP, in SI units."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from hil.errors import InputError
from hil.exporting.exported import WHAT, Exported, What, tables_of
from hil.exporting.write_csv import write_csv
from hil.exporting.write_mat import write_mat
from hil.exporting.write_mcap import write_mcap
from hil.exporting.write_parquet import write_parquet
from hil.records.atomic import replacing

Format = Literal["csv", "parquet", "mat", "mcap"]
FORMATS: tuple[Format, ...] = get_args(Format)
ONE_TABLE = ("csv", "parquet")
"""Formats that hold one table; the others hold several."""

_WRITERS: Mapping[str, Callable[[Sequence[Exported], Path], None]] = {
    "csv": lambda tables, path: write_csv(tables[0], path),
    "parquet": lambda tables, path: write_parquet(tables[0], path),
    "mat": write_mat,
    "mcap": write_mcap,
}


def format_for(target: Path, to: str | None) -> str:
    """The format asked for, by default the one that the name of `target` ends with. Raises InputError where the name
    says none, or another one.
    """
    ending = target.suffix.removeprefix(".").lower()
    if to is None:
        if ending not in FORMATS:
            raise InputError(f"{target}: its name ends with no format; known are {', '.join(FORMATS)}, or give --to")
        return ending
    if ending in FORMATS and to in FORMATS and ending != to:
        raise InputError(
            f"--to {to}: {target} is named as {ending}; name it {target.with_suffix(f'.{to}')}, or leave out --to"
        )
    return to


class Written(NamedTuple):
    """Rows of each table that was written; what the format does not carry of them, in words; which were interrupted."""

    rows: dict[str, int]
    left_out: tuple[str, ...]
    cut: tuple[str, ...]


def export(place: Path, target: Path, to: str, what: Sequence[str] = ()) -> Written:
    """Write what is named of the run folder or record file at `place` to `target`, whole or not at all.

    what: tables by name.  Without one, CSV and Parquet have the capture (of another file what is in it), MAT and MCAP
    all that was recorded and estimated.  Raises InputError for a format, a table or a file that cannot be used.
    """
    if to not in FORMATS:
        raise InputError(f"--to: {to} is no known format; known are {', '.join(FORMATS)}")
    names: list[What] = []
    for name in what:
        known = [one for one in WHAT if one == name]
        if not known:
            raise InputError(f"--what: {name} is not known; known are {', '.join(WHAT)}")
        names += known
    if to in ONE_TABLE:
        if len(names) > 1:
            raise InputError(f"--to: {to} holds one table, not {len(names)}; export one by one, or to mat or mcap")
        if not names and place.is_dir():
            names = ["capture"]
    tables = tables_of(place, names)
    with replacing(target) as temporary:
        _WRITERS[to](tables, temporary)
    left_out = tables[0].beside if to == "csv" else ()
    cut = tuple(f"{table.name}: {table.cut}" for table in tables if table.cut)
    return Written({table.name: table.rows for table in tables}, left_out, cut)
