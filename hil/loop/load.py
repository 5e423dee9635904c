"""What the loop's process had of the machine: time on a processor, and time it waited for one."""

import math
import os
import resource
import time
from pathlib import Path
from typing import NamedTuple

_SCHEDULED = Path("/proc/self/schedstat")  # ns on a processor, ns ready to run without one, turns
_PROCESSORS = Path("/proc/stat")  # first line: cpu, user, nice, system, idle, iowait, irq, softirq, steal, … in ticks
_STEAL = 8
_PRESSURE = Path("/proc/pressure/cpu")  # some avg10=… avg60=… avg300=… total=µs


class _Reading(NamedTuple):
    """Seconds on the clock; of this process on a processor, and ready to run without one; of a processor taken away by
    what runs this machine; of anything here waiting for a processor. Not a number where the system does not say."""

    clock: float
    busy: float
    waited: float
    stolen: float
    pressed: float


class LoadMeter:
    """Measures from its making on."""

    def __init__(self) -> None:
        self._begin = _read()
        self._end = self._begin

    def stop(self) -> None:
        """The loop has ended: what follows does not count."""
        self._end = _read()

    def load(self) -> dict[str, float]:
        """Shares of the time measured, as `hil.records.result.Load`; call it when the recorder has ended."""
        spent = _Reading(*(end - begin for begin, end in zip(self._begin, self._end, strict=True)))
        recorder = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = {
            "loop": spent.busy,
            "recorder": recorder.ru_utime + recorder.ru_stime,
            "waited": spent.waited,
            "stolen": spent.stolen,
            "pressed": spent.pressed,
        }
        return {name: value / spent.clock for name, value in seconds.items() if not math.isnan(value)}


def _read() -> _Reading:
    ticks_s = 1.0 / (os.sysconf("SC_CLK_TCK") * (os.cpu_count() or 1))
    return _Reading(
        time.monotonic(),
        time.process_time(),
        1e-9 * _number(_SCHEDULED, 1),
        ticks_s * _number(_PROCESSORS, _STEAL),
        1e-6 * _number(_PRESSURE, 4),
    )


def _number(path: Path, word: int) -> float:
    """A number, perhaps after a name and =, in a file of the kernel; not a number where there is no such file."""
    try:
        return float(path.read_text(encoding="ascii").split()[word].rpartition("=")[2])
    except OSError:
        return math.nan
