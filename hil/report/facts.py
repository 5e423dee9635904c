"""The line below the title: when, which board, over which link, on whose clock, how long, with which version."""

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.boards.emulation import shown
from hil.errors import InputError
from hil.numbers import significant
from hil.records.result import Result
from hil.records.runfolder import RunFolder

if TYPE_CHECKING:
    from hil.records.diagnosis import Diagnosis

_STAMP = "%Y%m%d-%H%M%S"
_LENGTH = len("20250314-092653")


def facts(result: Result, bench: Mapping[str, Any]) -> Iterator[str]:
    """Those that are known, in words; the date is that in the name of the run."""
    if (when := date_of(result.run)) is not None:
        yield when
    device = bench.get("device")
    name = device.get("name") if isinstance(device, Mapping) else None
    named = [word for word in (name or (result.sensor and result.sensor.device), result.serial_number) if word]
    if named:
        yield f"board {' '.join(named)}"
    if result.link is not None:
        yield shown(result.link)
    yield "a replay" if result.clock is None and result.sensor is None else result.clock or "its own clock"
    yield f"{significant(result.seconds, 4)} s"
    if (made_by := result.versions.get("gyrohil")) is not None:
        yield f"gyrohil {made_by}"


def facts_of_trace(folder: Path, diagnosis: "Diagnosis", length: str) -> Iterator[str]:
    """The same of a trace in `folder`: its own date, the bench file's device, the link and the length of its record,
    the version that traced it; the link where the record is a run that lies beside it.
    """
    if (when := date_of(folder.name)) is not None:
        yield when
    yield f"bench {diagnosis.bench}"
    with suppress(InputError):  # a run of which nothing can be told is no reason for a trace to have no page
        run = RunFolder(folder.parent / diagnosis.record).result
        if run is not None and run.link is not None:
            yield shown(run.link)
    yield length
    yield f"gyrohil {version('gyrohil')}"


def date_of(name: str) -> str | None:
    """The date in the name of a folder, as made by this bench; None where there is none.

    >>> date_of("20250314-092653-s-slow")
    '14 March 2025, 09:26'
    """
    with suppress(ValueError):
        when = time.strptime(name[:_LENGTH], _STAMP)
        return f"{when.tm_mday} {_MONTHS[when.tm_mon - 1]} {when.tm_year}, {when.tm_hour:02}:{when.tm_min:02}"
    return None


_MONTHS = (
    "January", "February", "March", "April", "May", "June", "July", "August", "September", "October", "November",
    "December",
)  # fmt: skip
