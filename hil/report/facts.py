"""The line below the title: when, which board, over which link, on whose clock, how long, with which version."""

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import PurePath
from typing import Any

from hil.emulation import is_emulated
from hil.records.result import Result
from hil.report.numbers import significant

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
        kind, _, place = result.link.partition(":")
        yield f"{kind}:{PurePath(place).name if is_emulated(result.link) else place}"
    yield "a replay" if result.clock is None and result.sensor is None else result.clock or "its own clock"
    yield f"{significant(result.seconds, 4)} s"
    if (version := result.versions.get("gyrohil")) is not None:
        yield f"gyrohil {version}"


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
