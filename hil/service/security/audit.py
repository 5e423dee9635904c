"""The audit log: who changed what, when, and what came of it.  One JSON object a line; nothing ever takes one away."""

import json
import logging
import os
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hil.errors.ending import line_of
from hil.service.problems import Problem
from hil.service.security.tokens import Holder

_KEPT = 1000
_TORN = b" (torn)\n"
"""Ends a line of which a part was written: it is no entry, even where all but its end is there."""

_LOG = logging.getLogger("hil.service")


class Audit:
    """Appends to `path`; the newest entries can be read back. `write` is `os.write`."""

    def __init__(self, path: Path, write: Callable[[int, bytes], int] = os.write) -> None:
        self._path = path
        self._write = write
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
        size = os.fstat(self._file).st_size
        self._torn = size > 0 and os.pread(self._file, 1, size - 1) != b"\n"

    def note(self, who: Holder | str, what: str, **details: Any) -> None:
        """One entry. When this returns it outlives a kill of the process, if not a loss of power.

        Raises Problem where it cannot be written: the caller must then not do what was to be noted.
        """
        name = who if isinstance(who, str) else who.name
        entry = {"time": time.time(), "who": name, "what": what, **details}
        line = json.dumps(entry, ensure_ascii=False, default=str).encode("utf-8", "replace") + b"\n"
        rest = _TORN + line if self._torn else line  # what was torn by a full disk ends there, and takes no other along
        try:
            while rest:
                written = self._write(self._file, rest)
                self._torn = self._torn or written > 0
                rest = rest[written:]
        except OSError as error:
            told = f"the audit log: {line_of(error)}"
            raise Problem(507, told, "nothing was done; make room and ask again") from None
        self._torn = False

    def note_anyway(self, who: Holder | str, what: str, **details: Any) -> None:
        """The same of what is done whether it can be noted or not: SAFE, and all else that stops or gives back."""
        try:
            self.note(who, what, **details)
        except Problem as problem:
            _LOG.error("%s: not in the audit log: %s", what, problem.error)

    def entries(self, count: int = _KEPT) -> list[dict[str, Any]]:
        """The newest entries, the newest first; a line that was cut by a crash or a full disk is left out."""
        found = []
        with self._path.open("rb") as file:
            for line in deque(file, maxlen=count):
                try:
                    found.append(json.loads(line))
                except ValueError:
                    continue
        return found[::-1]

    def close(self) -> None:
        os.close(self._file)
