"""The audit log: who changed what, when, and what came of it.  One JSON object a line; nothing ever takes one away."""

import json
import os
import time
from collections import deque
from pathlib import Path
from typing import Any

from hil.service.security.tokens import Holder

_KEPT = 1000


class Audit:
    """Appends to `path`; the newest entries can be read back."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)

    def note(self, who: Holder | str, what: str, **details: Any) -> None:
        """One entry, on the disk when this returns to whoever kills the process, if not to whoever cuts its supply."""
        name = who if isinstance(who, str) else who.name
        entry = {"time": time.time(), "who": name, "what": what, **details}
        os.write(self._file, json.dumps(entry, ensure_ascii=False, default=str).encode("utf-8", "replace") + b"\n")

    def entries(self, count: int = _KEPT) -> list[dict[str, Any]]:
        """The newest entries, the newest first; a line that was cut by a crash is left out."""
        found = []
        with self._path.open("rb") as file:
            for line in deque(file, maxlen=count):
                try:
                    found.append(json.loads(line))
                except ValueError:
                    continue
        return found[::-1]

    def close(self) -> None:
        """No more entries."""
        os.close(self._file)
