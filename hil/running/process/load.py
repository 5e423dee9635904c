"""What the loop had of the machine: time on a processor, and time it waited for one; what its recorder had."""

import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

_SCHEDULED = Path("/proc/thread-self/schedstat")  # ns on a processor, ns ready to run without one, turns
_PROCESSORS = Path("/proc/stat")  # first line: cpu, user, nice, system, idle, iowait, irq, softirq, steal, … in ticks
_STEAL = 8
_PRESSURE = Path("/proc/pressure/cpu")  # some avg10=… avg60=… avg300=… total=µs


class _Reading(NamedTuple):
    """Seconds on the clock; of this thread on a processor, and ready to run without one; of the recorder on a
    processor; of a processor used by the hypervisor; of anything here waiting for a processor. Not a number where the
    system does not say."""

    clock: float
    loop: float
    waited: float
    recorder: float
    stolen: float
    pressed: float


class LoadMeter:
    """Measures the calling thread from its making on; `recorder` says for how long, s, the recorder has had a
    processor."""

    def __init__(self, recorder: Callable[[], float]) -> None:
        self._recorder = recorder
        self._begin = self._end = self._read()

    def stop(self) -> None:
        """The loop has ended: what follows does not count. Call it in the same thread, while the recorder is there."""
        self._end = self._read()

    def load(self) -> dict[str, float]:
        """Shares of the time measured, as `hil.records.result.Load`: all of them over the same time."""
        spent = {name: getattr(self._end, name) - getattr(self._begin, name) for name in _Reading._fields}
        clock = spent.pop("clock")
        return {name: value / clock for name, value in spent.items() if not math.isnan(value)}

    def _read(self) -> _Reading:
        ticks_s = 1.0 / (os.sysconf("SC_CLK_TCK") * (os.cpu_count() or 1))
        return _Reading(
            time.monotonic(),
            time.thread_time(),
            1e-9 * _number(_SCHEDULED, 1),
            self._recorder(),
            ticks_s * _number(_PROCESSORS, _STEAL),
            1e-6 * _number(_PRESSURE, 4),
        )


def _number(path: Path, word: int) -> float:
    """A number, perhaps after a name and =, in a file of the kernel; not a number where there is no such file."""
    try:
        return float(path.read_text(encoding="ascii").split()[word].rpartition("=")[2])
    except OSError:
        return math.nan
