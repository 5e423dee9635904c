"""The records of a draw as a campaign of `hil.sweeping`: side by side, gone on with after any kill, rows as Parquet."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evaluation.undeclared import carrying
from evaluation.undeclared.judging import Judgement, judge
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import made_of
from hil.errors import InputError
from hil.progress import Watcher
from hil.sweeping.kept import read_rows
from hil.sweeping.sweep import sweep
from hil.sweeping.tasks import Row, Task

if TYPE_CHECKING:
    import pyarrow

IDENTITY = {
    "run": ("int64", "its number in the campaign"),
    "name": ("string", "of the record and its folder"),
    "category": ("string", "single · clean · calm · outside · double · never"),
    "hidden": ("string", "what nobody declared, with + between"),
    "seed": ("int64", "from the draw and the name"),
}
FIGURES = {
    "outcome": ("string", "made · traced · refused: the tracer would not · crashed: its process died"),
    "reason": ("string", "why, where it was not traced"),
    "samples": ("int64", "recorded"),
    "record_sha256": ("string", "of capture.arrow"),
    "innovation_ratio": ("float64", "of the loop's own observer, over the true noise, second half"),
    "verdict": ("string", "of the trace"),
    "named": ("string", "what it named, in its order, with + between"),
    "right": ("bool", "the best answer of its category"),
    "first_class": ("bool", "the class of what is hidden is named first"),
    "first_member": ("bool", "what is hidden is named first"),
    "misnamed": ("bool", "a wrong name, without reserve"),
    "before": ("float64", "innovation on the held-out part over the true noise"),
    "after": ("float64", "the same with what was named"),
    "judgement": ("string", "all of it, as JSON"),
}
_ROWS_PER_FILE = 64


@dataclass(frozen=True)
class Records:
    """The records of `orders` below `folder`: made, where they are not there, if `making`; traced and judged if
    `tracing`, with answers of an earlier estimator if `keep`.
    """

    orders: Sequence[Order]
    folder: Path
    samples: int
    making: bool = True
    tracing: bool = True
    keep: bool = False
    name: str = "undeclared"
    rows_per_file: int = _ROWS_PER_FILE

    def __len__(self) -> int:
        return len(self.orders)

    @property
    def program(self) -> str:
        """Of the carrier."""
        return carrying.program()

    @property
    def schema(self) -> "pyarrow.Schema":
        """Of the results; meanings in the metadata of the columns."""
        import pyarrow as pa

        kinds = {"int64": pa.int64(), "float64": pa.float64(), "string": pa.string(), "bool": pa.bool_()}
        columns = {**IDENTITY, **FIGURES}.items()
        return pa.schema([pa.field(name, kinds[kind], metadata={"meaning": what}) for name, (kind, what) in columns])

    @cached_property
    def fingerprint(self) -> str:
        """Of records and what is done with them."""
        return hashlib.sha256(json.dumps(self.as_run(), sort_keys=True).encode()).hexdigest()

    @property
    def results(self) -> Path:
        """Folder of the results, one for each set of records and each program."""
        return self.folder / "campaigns" / f"{self.fingerprint[:12]}-{self.program}"

    def identity(self, number: int) -> Row:
        """Name, what is hidden, seed."""
        order = self.orders[number]
        hidden = "+".join(order.effects)
        return {
            "run": number, "name": order.name, "category": order.category, "hidden": hidden, "seed": order.seed,
        }  # fmt: skip

    def task(self, number: int, scratch: str | None = None) -> Task:
        """A record as it is handed out."""
        order = self.orders[number]
        what = {
            "category": order.category, "effects": list(order.effects), "number": order.number, "draw": order.draw,
            "folder": str(self.folder.absolute()), "samples": self.samples, "make": self.making, "trace": self.tracing,
            "keep": self.keep,
        }  # fmt: skip
        return Task(number, carrying.__name__, what, scratch)

    def require_sound(self) -> None:
        """Raise InputError for records that are there and are of another draw or length."""
        for order in self.orders:
            if (self.folder / order.name / "truth.json").exists():
                made_of(order, self.folder, self.samples)

    def as_run(self) -> dict[str, Any]:
        """Which records, and what is done with them."""
        return {
            "records": [order.name for order in self.orders], "draws": sorted({order.draw for order in self.orders}),
            "samples": self.samples, "making": self.making, "tracing": self.tracing, "keep": self.keep,
        }  # fmt: skip


def carried_out(records: Records, workers: int | None, progress: Watcher, *, scheduler: str | None = None) -> list[Row]:
    """The rows of all records, made as far as they are not there, by so many processes here or on the Dask cluster of
    `scheduler`, whose workers have the folder of the records too.  Raises as `hil.sweeping.sweep.sweep` does.
    """
    sweep(records, records.results, workers=workers, scheduler=scheduler, progress=progress)
    rows: list[Row] = read_rows(records.results, records.schema).to_pylist()
    lost = [row["name"] for row in rows if row["record_sha256"] is None]
    if lost:
        raise InputError(f"{records.results}: no record came of {', '.join(lost)}; the column reason says why")
    return rows


def judgements(records: Records, rows: Sequence[Row]) -> list[Judgement]:
    """Of each row."""
    return [carrying.read(row["judgement"]) if row["judgement"] else _untraced(records, row) for row in rows]


def _untraced(records: Records, row: Row) -> Judgement:
    """Of a record whose trace killed its process."""
    return judge(json.loads((records.folder / row["name"] / "truth.json").read_text()), None)
