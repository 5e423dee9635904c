"""What a campaign hands out and takes back."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

Row = dict[str, Any]


@dataclass(frozen=True)
class Task:
    """A run as it is handed to a worker: plain text, the same on every machine.

    what: for `hil.sweeping.one_run`, as JSON has it; scratch: a folder for what is being made.
    """

    run: int
    what: Mapping[str, Any]
    scratch: str | None = None

    def as_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "Task":
        return cls(**json.loads(text))


@dataclass(frozen=True)
class Done:
    """A run that was carried out: its row, which follows from the task alone, and what was measured on the wall."""

    run: int
    row: Row
    wall: Mapping[str, Any]
