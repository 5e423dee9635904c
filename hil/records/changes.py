"""Settings that changed while a loop ran: `changes.jsonl` of a run folder, one JSON object a line."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from hil.errors import InputError

CHANGES = "changes.jsonl"


class Change(NamedTuple):
    """All settings in force from the sample of `tick` on, as `hil.running.process.live_settings` names them."""

    tick: int
    settings: dict[str, float]


def note_change(folder: Path, tick: int, settings: Mapping[str, float]) -> None:
    """One more line. Raises OSError."""
    with (folder / CHANGES).open("a", encoding="utf-8") as file:
        file.write(json.dumps({"tick": tick, **settings}) + "\n")


def read_changes(folder: Path) -> list[Change]:
    """In the order of their ticks, none where nothing changed; a last line that was cut by a crash is left out.

    Raises InputError with the line that is no change.
    """
    path = folder / CHANGES
    if not path.exists():
        return []
    *lines, _cut = path.read_text(encoding="utf-8", errors="replace").split("\n")
    return sorted((_change(path, number, line) for number, line in enumerate(lines, 1)), key=lambda one: one.tick)


def _change(path: Path, number: int, line: str) -> Change:
    try:
        told = json.loads(line)
        tick = told.pop("tick")
        settings = {name: float(value) for name, value in told.items()}
    except (ValueError, TypeError, AttributeError, KeyError):
        settings, tick = {}, None
    if not isinstance(tick, int) or not all(map(math.isfinite, settings.values())) or not settings:
        raise InputError(f"{path}: line {number} is no change of settings; take it out, or the whole file")
    return Change(tick, settings)
