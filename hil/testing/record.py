"""A record as acceptance tests see it: imported where it is no capture yet, replayed, traced."""

from pathlib import Path
from typing import Unpack

import hil
from hil.importing.options import ImportOptions
from hil.library.keywords import takes
from hil.progress import untold
from hil.records.capture import Capture, read_capture
from hil.records.listing import named
from hil.replaying.options import ReplayOptions
from hil.tracing.options import TraceOptions


class RecordUnderTest:
    """A run's folder, a capture, or a file that `hil import` reads.

    Attributes:
        path: the capture.
        bench: the bench file by which it is replayed and traced, None for that of its run.
    """

    def __init__(self, place: Path, bench: Path | None, aside: Path, **options: Unpack[ImportOptions]) -> None:
        """What is made of it lies below `aside`.  Raises InputError where it cannot be read."""
        self.bench = bench
        self._aside = aside
        place = named(place)
        if place.is_dir():
            place = place / "capture.arrow"
        elif place.suffix != ".arrow":
            place = hil.import_record(place, out=aside / f"{place.stem}.arrow", replace=True, **options).path
        self.path = place

    @property
    def capture(self) -> Capture:
        """Its samples."""
        return read_capture(self.path)

    @takes(ReplayOptions)
    def replay(self, **options: Unpack[ReplayOptions]) -> hil.Run:
        """As `hil.replay`."""
        return hil.replay(self.path, self.bench, out=self._aside / "runs", progress=untold, **options)

    @takes(TraceOptions)
    def trace(self, **options: Unpack[TraceOptions]) -> hil.Trace:
        """As `hil.trace`."""
        return hil.trace(self.path, self.bench, out=self._aside / "runs", progress=untold, **options)
