"""What a campaign hands out and takes back, whatever its tasks are."""

import importlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import pyarrow

Row = dict[str, Any]


@dataclass(frozen=True)
class Task:
    """A run as it is handed to a worker: plain text, the same on every machine.

    carrier: the module that knows how, with what a `Carrier` has; what: for its eyes, as JSON has it; scratch: a folder
    for what is being made.
    """

    run: int
    carrier: str
    what: Mapping[str, Any]
    scratch: str | None = None

    def as_json(self) -> str:
        """In one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "Task":
        """Back again."""
        return cls(**json.loads(text))


@dataclass(frozen=True)
class Done:
    """A run that was carried out: its row, which follows from the task alone, and what was measured on the wall."""

    run: int
    row: Row
    wall: Mapping[str, Any]


class Carrier(Protocol):
    """A module that carries tasks out."""

    def carry_out(self, task: Task) -> Done:
        """Do it; what a run may come to is in its row.  Raises OSError where this machine, not the run, is at fault."""
        ...

    def program(self) -> str:
        """The same for programs that make the same rows."""
        ...


def carrier_of(task: Task) -> Carrier:
    """The module of a task."""
    found: Carrier = importlib.import_module(task.carrier)
    return found


class Tasks(Protocol):
    """A campaign as it is swept: how many runs, which, and what its results look like."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    @property
    def rows_per_file(self) -> int:
        """Rows of a Parquet file."""
        ...

    @property
    def fingerprint(self) -> str:
        """The same for campaigns whose runs are the same."""
        ...

    @property
    def program(self) -> str:
        """As its carrier gives it."""
        ...

    @property
    def schema(self) -> "pyarrow.Schema":
        """Of the results, `run` first."""
        ...

    def __len__(self) -> int: ...

    def identity(self, number: int) -> Row:
        """The part of a run's row that is known before it is made."""
        ...

    def task(self, number: int, scratch: str | None = None) -> Task:
        """A run as it is handed out.  Raises InputError where it cannot be."""
        ...

    def require_sound(self) -> None:
        """Before the first run of all: raise InputError for what would keep every one from beginning."""
        ...

    def as_run(self) -> Mapping[str, Any]:
        """What is run, to be kept with the results."""
        ...
