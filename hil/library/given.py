"""Records and benches as they are given: as objects, as paths, by names, as arrays."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy.typing as npt

from hil.bench import Bench, RateSensorBench, load_any_bench
from hil.bench.examples import bench_file
from hil.errors import InputError
from hil.importing.demodulated import carrier_of
from hil.importing.importer import import_from, require_keys_act
from hil.importing.mapping import read_map
from hil.importing.options import ImportOptions
from hil.importing.record_time import Remedies
from hil.importing.request import map_of, require_hold
from hil.importing.source import ArraySource
from hil.library.loading import Run, folder_of
from hil.library.series import Series
from hil.options import chosen
from hil.records.capture import Hold
from hil.records.runfolder import bench_of_record
from hil.verdict.next_step import PASSING

CALLED = "the arrays given"
_REMEDIES = Remedies(
    uneven="give nonuniform=True if the record is meant so",
    gaps="give nonuniform=True to keep them as gaps",
    rate="beside t_s in a map given as mapping=",
    sort="sort the rows",
    column="t_s",
    apart="give what lies before and behind by itself",
)


class Table(Protocol):
    """Columns by name: a Series, a frame of pandas, a table of pyarrow."""

    @property
    def columns(self) -> Any:
        """Their names, or in pyarrow themselves."""

    def __getitem__(self, name: Any, /) -> Any: ...


def columns_of(record: Any) -> dict[str, npt.ArrayLike] | None:
    """The arrays of a record by name: of a mapping, a Series, or a table of pandas or pyarrow, whose time may be the
    index; None where it is none of them.
    """
    if isinstance(record, Series):
        return {"t_s": record.t_s, **{name: record[name] for name in record}}
    if isinstance(record, Mapping):
        names = list(record)
    elif hasattr(record, "columns"):
        if getattr(getattr(record, "index", None), "name", None) == "t_s":
            record = record.reset_index()
        names = list(getattr(record, "column_names", record.columns))
    else:
        return None
    return {str(name): record[name] for name in names}


def write_capture(
    columns: Mapping[str, npt.ArrayLike],
    target: Path,
    *,
    hold: Hold | None = None,
    nonuniform: bool = False,
    map_file: Path | None = None,
    demodulated: str | None = None,
) -> None:
    """Write the capture of `columns`, (n,) each, by the map at `map_file`, or by their names in an interchange CSV:
    t_s, vx_V, vy_V, ux_mps2 and uy_mps2 (or _V, _N), and optionally rate_rad_s and temp_C; a single axis leaves out y.
    demodulated: as `hil import --demodulated`.

    Time may be datetime64, timedelta64 or ISO 8601 text too, and is even unless `nonuniform`.  Raises InputError that
    names the column.
    """
    mapping = None if map_file is None else read_map(map_file)
    if mapping is not None:
        require_keys_act(mapping, ArraySource.kind, CALLED, map_file)
    source = ArraySource(columns, CALLED)
    import_from(
        source, target, mapping, map_file=map_file, hold=hold, nonuniform=nonuniform, remedies=_REMEDIES,
        carrier=carrier_of(demodulated),
    )  # fmt: skip


AnyBench = Bench | RateSensorBench | Path | str
Record = Run | Path | str | Mapping[str, npt.ArrayLike] | Table
Records = Record | Sequence[Record]


def several(given: Records) -> tuple[Record, ...]:
    """One record, or those of a list."""
    return tuple(given) if isinstance(given, list | tuple) else (given,)  # type: ignore[return-value]


def bench_for(records: Records, bench: AnyBench | None) -> AnyBench:
    """The bench that is given, or else that of the run which the record belongs to.  Raises InputError."""
    if isinstance(bench, Bench | RateSensorBench):
        return bench
    if bench is not None:
        return bench_file("bench", bench)
    if len(several(records)) > 1:
        raise InputError("--bench: missing; of several records, name the one for all of them")
    (record,) = several(records)
    if isinstance(record, Run):
        return record.bench
    if isinstance(record, str | Path) and (own := bench_of_record(folder_of("record", record))) is not None:
        return own
    raise InputError("no bench: give the bench file that declares the device of this record")


def observed_bench_for(record: Record, bench: AnyBench | None, name: str) -> Bench:
    """The same for an observer, with that name where none is given in it.  Raises InputError for a rate sensor."""
    declared = bench_for(record, bench)
    if isinstance(declared, str | Path):
        declared = load_any_bench(Path(declared))
    if isinstance(declared, RateSensorBench):
        raise InputError(f"{declared.device.name}: a rate sensor, which no observer runs on; trace its record")
    return declared.with_(loop={"name": name.format(declared.loop.name)})


@contextmanager
def captured(records: Records, options: ImportOptions) -> Iterator[tuple[Path, ...]]:
    """The captures of records; of arrays one that lasts as long as it is needed, and that no error names."""
    given = chosen(ImportOptions, options)
    require_hold(given["hold"])
    with ExitStack() as kept:
        yield tuple([kept.enter_context(_captured(record, given)) for record in several(records)])


@contextmanager
def _captured(record: Record, given: Mapping[str, Any]) -> Iterator[Path]:
    if (columns := columns_of(record)) is None:
        if given["mapping"] is not None:
            raise InputError("mapping: is for arrays; a file is imported by its map, and the capture given here")
        wanted = "a Run, the path of a run folder or of a capture, or arrays by name"
        place_of = folder_of("record", record, wanted)
        yield place_of / "capture.arrow" if place_of.is_dir() else place_of
        return
    with tempfile.TemporaryDirectory(prefix=PASSING) as place:
        capture = Path(place) / "arrays.arrow"
        own, told = (
            record.header.get(name, given[name]) if isinstance(record, Series) else given[name]
            for name in ("hold", "demodulated")
        )  # fmt: skip
        write_capture(
            columns, capture, hold=own, nonuniform=given["nonuniform"], map_file=map_of(given["mapping"]),
            demodulated=told,
        )  # fmt: skip
        try:
            yield capture
        except InputError as error:
            raise InputError(str(error).replace(str(capture), CALLED)) from None
