"""The one reader of a run's rings in this service, whatever the number of clients."""

import asyncio
import logging
import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from hil.service.telemetry.now import Now
from hil.service.telemetry.tracks import Tracks
from hil.service.telemetry.views import Rolls

LOOKS_PER_S = 50.0
_LOG = logging.getLogger(__name__)


class Hub:
    """Looks at the rings, and wakes those that wait for news.

    Attributes:
        tracks: of the run that lasts or was the last one.
        rolls: decimated channels of it.
        run: counts the runs: views of another one are made anew.
        looked: called after each look that brought something.
    """

    def __init__(self) -> None:
        self.tracks, self.rolls, self.now = Tracks(), Rolls(), Now()
        self.run = 0
        self.looked: set[Callable[[], None]] = set()
        self._live = False

    def attach(self, stem: str, layout: dict[str, Any], descriptor: int) -> None:
        """A ring of the run that begins; `descriptor` is closed."""
        try:
            if not self._live:
                self.detach()
                self.tracks, self.rolls, self.now = Tracks(), Rolls(), Now()
                self.run += 1
                self._live = True
            with suppress(OSError, ValueError):
                self.tracks.add(stem, layout, descriptor)
        finally:
            os.close(descriptor)

    def end(self) -> None:
        """The run has ended: what is still in its rings is looked at once more."""
        if self._live:
            try:
                self.look()
            finally:
                self._live = False

    @property
    def live(self) -> bool:
        """Whether a run lasts."""
        return self._live

    @property
    def ready(self) -> bool:
        """Whether a run lasts whose rings are all there: that of the times comes after what is drawn."""
        return self._live and self.tracks.get("timing") is not None

    def detach(self) -> None:
        """Let the rings go: nothing is looked at until others are attached."""
        self._live = False
        self.tracks.close()

    def look(self) -> None:
        """Take what is new."""
        if not self._live or not self.tracks.look():
            return
        self.rolls.add_new(self.tracks)
        self.now.look(self.tracks)
        for act in list(self.looked):
            act()

    async def follow(self) -> None:
        """Look for as long as the service lives."""
        clock = asyncio.get_running_loop().time
        due = clock()
        while True:
            try:
                self.look()
            except Exception:  # noqa: BLE001 - clients would go on being shown what was
                _LOG.exception("the new rows of the run could not be read; it is tried again")
            due = max(due + 1.0 / LOOKS_PER_S, clock())
            await asyncio.sleep(due - clock())
