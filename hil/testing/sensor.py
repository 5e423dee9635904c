"""A sensor that cannot be driven, as acceptance tests see it."""

from pathlib import Path
from typing import Unpack

import hil
from hil.library.keywords import takes
from hil.progress import untold
from hil.sensors.options import RecordOptions
from hil.sensors.port import find_port


class SensorUnderTest:
    """The sensor at a link `NAME:PATH[?baud=N]`, NAME being that of an adapter; `adapter` decodes its stream."""

    def __init__(self, link: str, runs: Path) -> None:
        """Recordings are made below `runs`.  Raises InputError where there is no such adapter."""
        self.link = link
        self.adapter = find_port(link).adapter
        self._runs = runs

    @takes(RecordOptions)
    def record(self, **options: Unpack[RecordOptions]) -> hil.Run:
        """As `hil.record`."""
        return hil.record(self.link, out=self._runs, progress=untold, **options)
