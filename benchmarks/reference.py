"""A commercial gyro recorded beside a run: the turnaround of force mode with it, over that without it.

S-slow at 4 kHz over a pty, in real time, with and without in turns (with, without, without, with, …): whatever else the
machine does, it does to both.  An emulated STIM300 speaks all the time, 1000 datagrams a second; where the run has no
reference, its line is emptied by `cat`.  The ratio is that of one run to the one beside it.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.force_mode import SEED
from benchmarks.lockstep import bench_of
from benchmarks.row import Row, Say
from hil.bench import examples, override
from hil.progress import alarms_only
from hil.records.result import Percentiles
from hil.records.runfolder import RunFolder
from hil.records.summary import turnaround
from hil.running.request import RunRequest
from hil.running.run import run

PAIRS, DURATION_S = 8, 10.0
SAMPLE_RATE_HZ = 1000.0
ALONE = "without a reference"


def rows(say: Say) -> list[Row]:
    """Percentiles of the runs with a reference, medians over the pairs, beside those without."""
    told: dict[bool, list[Percentiles]] = {True: [], False: []}
    with tempfile.TemporaryDirectory() as place, gyro() as line:
        for turn in range(2 * PAIRS):
            beside = turn % 4 in (0, 3)
            told[beside].append(measured(line if beside else None, line, Path(place)))
            say(f"{'with' if beside else 'without'}: {told[beside][-1].line}")
    found = []
    for name in ("p50", "p99"):
        with_it, without = ([getattr(one, name) for one in told[beside]] for beside in (True, False))
        ratios = [a / b for a, b in zip(with_it, without, strict=True)]
        found.append(Row.over(f"turnaround {name}", sorted(with_it)[PAIRS // 2], "µs", ALONE, ratios))
        found.append(Row(f"turnaround {name}, {ALONE}", sorted(without)[PAIRS // 2], "µs"))
    return found


def measured(reference: str | None, line: str, place: Path) -> Percentiles:
    """Of one run, beside the gyro on `line`."""
    loop = {"clock": "paced", "duration_s": DURATION_S, "settle_s": 8.0, "seed": SEED}
    link = {} if reference is None else {"link": f"stim300:{reference}"}
    bench = override(bench_of("s-slow"), {"loop": loop, "reference": link}, "benchmark")
    with emptied(line, unread=reference is None):
        folder = run(
            RunRequest(bench, f"pty:{examples.find('scenario', 's-slow')}", judged=False), place, progress=alarms_only
        ).folder
    timing = None if folder is None else RunFolder(folder).timing
    found = None if timing is None else turnaround(timing)
    assert found is not None
    return found


@contextmanager
def gyro() -> Iterator[str]:
    """The line of an emulated one, which is held open."""
    command = [sys.executable, "-m", "device_emulator.gyros", "stim300", "--sample-rate", str(SAMPLE_RATE_HZ)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline().removeprefix("ready serial:").strip()
        held = os.open(line, os.O_RDONLY | os.O_NOCTTY)
        try:
            yield line
        finally:
            os.close(held)
            process.terminate()


@contextmanager
def emptied(line: str, *, unread: bool) -> Iterator[None]:
    """Read away what comes on a line that nobody records."""
    if not unread:
        yield
        return
    with Path(line).open("rb") as source, subprocess.Popen(["cat"], stdin=source, stdout=subprocess.DEVNULL) as cat:
        yield
        cat.terminate()
