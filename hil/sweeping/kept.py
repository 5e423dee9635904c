"""The folder of a campaign: what is done stays done, however the campaign ends, and nothing is there twice.

    campaign.json     what is run, and by which program: a folder goes on with the same only
    results/file=N/rows.parquet   the rows of runs N·rows_per_file and following, in order, once all of them are there
    journal.jsonl     rows whose file is not full yet, a line each; gone when all runs are done
    wall.jsonl        how long each run took, where: measured on the wall, and so no part of the results
    work/             runs being made

A Parquet file appears whole or not at all, and only then do its rows leave the journal.  A line that a kill cut off
is no line: its run is made again, and comes out the same.
"""

import fcntl
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TextIO

from hil.errors import InputError
from hil.records.atomic import replacing, write_text
from hil.records.kind import CAMPAIGN, kind_of
from hil.sweeping.columns import schema
from hil.sweeping.plan import Plan
from hil.sweeping.tasks import Done, Row

if TYPE_CHECKING:
    import pyarrow

_LONGEST_JOURNAL = 64 << 20


class Kept:
    """The folder, open to be added to, by one process at a time."""

    def __init__(self, folder: Path, plan: Plan, program: str) -> None:
        self.folder, self.plan, self.program = folder, plan, program
        self._schema = schema(plan.campaign)
        self._per_file = plan.campaign.rows_per_file
        self._waiting: dict[int, Row] = {}
        self._files: set[int] = set()
        self._journal_path = folder / "journal.jsonl"
        self._journal: TextIO
        self._wall: TextIO

    @classmethod
    @contextmanager
    def opened(cls, folder: Path, plan: Plan, program: str) -> Iterator[Self]:
        """Make the folder, or go on in it.  Raises InputError where a run, another campaign, another program or
        another process is at home, or no folder can be made."""
        if (kind := kind_of(folder)) not in ("", CAMPAIGN):
            raise InputError(f"{folder}: {kind} is there, and its report would be replaced; give another --out")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: no folder can be made there ({error.strerror}); give another --out") from None
        with (folder / "lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise InputError(f"{folder}: another hil sweep is at work there; wait for it, or give --out") from None
            kept = cls(folder, plan, program)
            kept._require_same()
            kept._recover()
            kept._journal = kept._journal_path.open("a", encoding="utf-8")
            kept._wall = (folder / "wall.jsonl").open("a", encoding="utf-8")
            try:
                yield kept
            finally:
                kept._journal.close()
                kept._wall.close()
                shutil.rmtree(kept.work, ignore_errors=True)
            if not kept.missing:
                kept._journal_path.unlink(missing_ok=True)

    @property
    def work(self) -> Path:
        return self.folder / "work"

    @property
    def missing(self) -> int:
        return sum(1 for _ in self.to_do())

    def to_do(self) -> Iterator[int]:
        """Numbers of the runs that have no row yet, in order."""
        for start in range(0, len(self.plan), self._per_file):
            if start // self._per_file not in self._files:
                stop = min(start + self._per_file, len(self.plan))
                yield from (number for number in range(start, stop) if number not in self._waiting)

    def add(self, done: Done) -> bool:
        """Keep the row of a run; False where it is there already."""
        file = done.run // self._per_file
        if file in self._files or done.run in self._waiting:
            return False
        self._journal.write(json.dumps({"run": done.run, "row": done.row}) + "\n")
        self._journal.flush()
        self._wall.write(json.dumps({"run": done.run, **done.wall}) + "\n")
        self._wall.flush()
        self._waiting[done.run] = done.row
        self._write_if_full(file)
        if self._journal.tell() > _LONGEST_JOURNAL:
            self._rewrite_journal()
        return True

    def _row(self, number: int) -> Row:
        return {**self.plan.identity(number), **self._waiting[number]}

    def _write_if_full(self, file: int) -> None:
        runs = range(file * self._per_file, min((file + 1) * self._per_file, len(self.plan)))
        if not all(number in self._waiting for number in runs):
            return
        write_rows(file_path(self.folder, file), [self._row(number) for number in runs], self._schema)
        self._files.add(file)
        for number in runs:
            del self._waiting[number]

    def _rewrite_journal(self) -> None:
        """Only what waits; the lines of full files go."""
        self._journal.close()
        lines = (json.dumps({"run": number, "row": row}) for number, row in self._waiting.items())
        write_text(self._journal_path, "".join(f"{line}\n" for line in lines))
        self._journal = self._journal_path.open("a", encoding="utf-8")

    def _require_same(self) -> None:
        told = {
            "version": 2,  # of 1, angle_u_rad was the expanded uncertainty
            "name": self.plan.campaign.name,
            "runs": len(self.plan),
            "campaign": self.plan.fingerprint,
            "program": self.program,
        }
        path = self.folder / "campaign.json"
        if not path.exists():
            if (self.folder / "results").exists():
                raise InputError(f"{self.folder}: has results and no campaign.json; give another --out")
            write_text(path, json.dumps(told | {"as_run": dict(self.plan.as_run())}, indent=1) + "\n")
            return
        try:
            there = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise InputError(f"{path}: no JSON; give another --out") from None
        if there.get("campaign") != told["campaign"]:
            raise InputError(
                f"{self.folder}: holds runs of another campaign, or of this one before it was changed; give another "
                "--out, or remove it"
            )
        if there.get("program") != self.program:
            raise InputError(
                f"{self.folder}: its runs were made by another version of the program; give another --out, or remove it"
            )

    def _recover(self) -> None:
        """What is there: full files, then the journal up to where it was cut off."""
        shutil.rmtree(self.work, ignore_errors=True)
        results = self.folder / "results"
        if results.exists():
            for torn in results.glob("file=*/.*.part"):
                torn.unlink()
            self._files = {int(found.parent.name[5:]) for found in results.glob("file=*/rows.parquet")}
        end = 0
        for line, stop in _whole_lines(self._journal_path):
            end = stop
            done = Done(line["run"], line["row"], {})
            if done.run // self._per_file not in self._files:
                self._waiting[done.run] = done.row
        if self._journal_path.exists():
            os.truncate(self._journal_path, end)
        for file in {number // self._per_file for number in self._waiting}:
            self._write_if_full(file)

    def table(self) -> "pyarrow.Table":
        return read_rows(self.folder, self._schema, map(self._row, self._waiting))


def file_path(folder: Path, file: int) -> Path:
    """Where the rows of a file stand."""
    return folder / "results" / f"file={file:05d}" / "rows.parquet"


def write_rows(path: Path, rows: Iterable[Row], schema: "pyarrow.Schema") -> None:
    """A Parquet file, the same bytes for the same rows."""
    import pyarrow as pa
    from pyarrow import parquet

    with replacing(path) as part:
        table = pa.Table.from_pylist(list(rows), schema=schema)
        parquet.write_table(table, part, compression="zstd", write_page_checksum=True)


def read_rows(folder: Path, schema: "pyarrow.Schema", more: Iterable[Row] = ()) -> "pyarrow.Table":
    """The rows of all files and some more, by their number. Raises InputError where a file is damaged."""
    import pyarrow as pa

    tables = [_read(found, schema) for found in sorted(folder.glob("results/file=*/rows.parquet"))]
    waiting = list(more)
    if waiting:
        tables.append(pa.Table.from_pylist(waiting, schema=schema))
    return pa.concat_tables(tables).sort_by("run") if tables else schema.empty_table()


def _read(path: Path, schema: "pyarrow.Schema") -> "pyarrow.Table":
    from pyarrow import ArrowException, parquet

    try:
        return parquet.ParquetFile(path, page_checksum_verification=True).read().cast(schema)
    except (OSError, ArrowException, ValueError) as error:
        told = str(error).partition("\n")[0]
        raise InputError(f"{path}: damaged ({told:.100}); remove it, and hil sweep makes its runs again") from None


def _whole_lines(path: Path) -> Iterator[tuple[dict[str, Any], int]]:
    """The lines of a journal with where they end, up to the first that is none."""
    if not path.exists():
        return
    end = 0
    with path.open("rb") as file:
        for raw in file:
            end += len(raw)
            if not raw.endswith(b"\n"):
                return
            try:
                line = json.loads(raw)
            except ValueError:
                return
            yield line, end
