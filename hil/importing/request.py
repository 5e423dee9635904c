"""An import as it is asked for: for every caller alike."""

from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from hil.bench import examples
from hil.errors import InputError
from hil.errors.input import path_of
from hil.importing.options import ImportOptions, LocalImportOptions
from hil.options import chosen
from hil.records.capture import Hold
from hil.records.kind import fresh


@dataclass(frozen=True)
class ImportRequest:
    """The file, the capture that is to be written, and how the file is to be understood, see `ImportOptions`."""

    source: Path
    target: Path
    map_file: Path | None = None
    hold: Hold | None = None
    nonuniform: bool = False
    dbc: str | None = None
    reference: str | None = None
    demodulated: str | None = None


def request_of(source: Path | str, options: ImportOptions) -> ImportRequest:
    """Put together what is asked, files of this machine too (`LocalImportOptions`).  Raises InputError."""
    given, file = chosen(LocalImportOptions, options), path_of("source", source)
    wanted = named_after(file) if given["out"] is None else path_of("out", given["out"])
    target = fresh(wanted, replace=bool(given["replace"]), source=file)
    require_hold(given["hold"])
    dbc = None if given["dbc"] is None else str(path_of("dbc", given["dbc"]))
    if given["reference"] is not None and dbc is None:
        raise InputError(f"--reference: {file} is imported without a DBC; give --dbc, or map the column to rate_rad_s")
    if given["demodulated"] is not None and dbc is not None:
        raise InputError("--demodulated: a log of CAN frames has no demodulated streams; leave out --dbc")
    return ImportRequest(
        file, target, map_of(given["mapping"]), given["hold"], bool(given["nonuniform"]), dbc, given["reference"],
        given["demodulated"],
    )  # fmt: skip


def require_hold(hold: object) -> None:
    """InputError for a hold that there is not."""
    holds = get_args(Hold)
    if hold is not None and hold not in holds:
        raise InputError(f"hold: expected {', '.join(holds[:-1])} or {holds[-1]}, not {hold!r}")


def map_of(mapping: Path | str | None) -> Path | None:
    """The map of that path or name.  Raises InputError where there is none."""
    return None if mapping is None else examples.find("map", str(path_of("mapping", mapping)))


def named_after(source: Path) -> Path:
    """The capture's name where none is given: that of the file without what says its format."""
    name = source.name.removesuffix(".gz")
    ending = Path(name).suffix
    return Path((name.removesuffix(ending) if ending[1:].isalpha() else name) + ".arrow")
