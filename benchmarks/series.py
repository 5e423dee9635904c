"""Windows of a long record: an hour of two axes at 100 kS/s, written with its pyramid, opened, zoomed into, drawn.

SERIES_ROWS=N for another length, SERIES_FOLDER for another place: a row takes 25 bytes.  Each window is read by a
process of its own, whose memory is told; its imports are not part of the time.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.row import Row
from hil.records.capture import board_layout
from hil.records.pyramid import Pyramid
from hil.records.stream import BlockWriter

ROWS = int(os.environ.get("SERIES_ROWS", "360000000"))
RATE_HZ = 100_000.0
_PIECE = 1 << 18
_TIMES = 7
_NAMES = ["capture.vx_V", "capture.vy_V", "capture.ux_mps2", "capture.uy_mps2"]

_READER = """
import json, os, resource, sys, time
from pathlib import Path
from hil.service.series import channels, window
folder, names, windows, cold = json.loads(sys.argv[1])
folder = Path(folder)
if cold:
    for path in folder.rglob("*.arrow"):
        with path.open("rb") as file:
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
told = []
for low, high in windows:
    began, worked = time.perf_counter(), time.process_time()
    frame = window(folder, names, low, high, 800)
    data = frame.packed()
    told.append((time.perf_counter() - began, time.process_time() - worked, frame.low.shape[1], len(data)))
usage = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps({"told": told, "rss_MB": usage.ru_maxrss / 1e3, "grown_MB": (usage.ru_maxrss - before) / 1e3}))
"""


def rows(tell: Callable[[str], None]) -> list[Row]:
    """Measure all of it."""
    with tempfile.TemporaryDirectory(dir=os.environ.get("SERIES_FOLDER"), prefix="series-") as place:
        folder = Path(place)
        tell(f"{ROWS} rows, {25e-9 * ROWS:.1f} GB")
        written = _write(folder)
        level_sizes = sum(path.stat().st_size for path in (folder / "pyramid").iterdir())
        made = [
            Row("rows", ROWS, ""),
            Row("pyramid over record, bytes", level_sizes / (folder / "capture.arrow").stat().st_size, ""),
            Row("pyramid's share of the time of writing", written["pyramid"] / written["both"], ""),
            Row("pyramid, processor time for 100,000 rows", 1e5 * 1e3 * written["pyramid"] / ROWS, "ms"),
        ]
        tell("written")
        end = ROWS / RATE_HZ
        middle = 0.5 * end
        for name, windows, cold in (
            ("opened, whole, not in memory", [(None, None)], True),
            ("opened, whole", [(None, None)] * _TIMES, False),
            ("zoom to 1 ms", [(middle + 0.37 * k, middle + 0.37 * k + 1e-3) for k in range(_TIMES)], False),
            ("zoom to 1 ms, not in memory", [(0.3 * end, 0.3 * end + 1e-3)], True),
            ("zoom to 1 s", [(middle + k, middle + k + 1) for k in range(_TIMES)], False),
            ("zoom to 10 s", [(0.2 * end + 11 * k, 0.2 * end + 11 * k + 10) for k in range(_TIMES)], False),
            ("zoom to a tenth", [(0.1 * end * k, 0.1 * end * (k + 1)) for k in range(_TIMES)], False),
        ):
            found = _read(folder, windows, cold=cold)
            times, worked = [one[0] for one in found["told"]], [one[1] for one in found["told"]]
            tell(
                f"{name}: median {statistics.median(times):.3f} s, at most {max(times):.3f} s, "
                f"processor {max(worked):.3f} s, {found['rss_MB']:.0f} MB"
            )
            made.append(Row(f"{name}, slowest of {len(times)}", max(times), "s"))
            made.append(Row(f"{name}, processor time", max(worked), "s"))
            made.append(Row(f"{name}, memory of the process", found["rss_MB"], "MB"))
        return made


def _read(folder: Path, windows: list[Any], *, cold: bool) -> dict[str, Any]:
    order = json.dumps([str(folder), _NAMES, windows, cold])
    done = subprocess.run([sys.executable, "-c", _READER, order], check=True, capture_output=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _write(folder: Path) -> dict[str, float]:
    """The record as the recorder writes it; processor time of all, and of the pyramid."""
    layout = board_layout(
        tick_rate_Hz=RATE_HZ, axes=2, latency_ticks=1, sense_scale_V=1e-4, drive_scale=1e-3, identity={"unique_id": 1}
    )
    drawn = np.random.default_rng(1)
    noise = drawn.integers(-40, 40, (4, _PIECE))
    writer, pyramid = BlockWriter(folder / "capture.arrow", layout), Pyramid(folder / "capture.arrow", layout)
    spent = {"both": 0.0, "pyramid": 0.0}
    data = np.zeros(_PIECE, layout.dtype)
    for start in range(0, ROWS, _PIECE):
        part = data[: min(_PIECE, ROWS - start)]
        tick = np.arange(start, start + part.size)
        phase = 2 * np.pi * 5_000 / RATE_HZ * (tick % 20)
        slow = 1 + 0.3 * np.sin(2 * np.pi * (start / RATE_HZ) / 600)
        part["tick"] = tick
        part["vx_code"] = 8_000 * slow * np.cos(phase) + noise[0, : part.size]
        part["vy_code"] = 3_000 * slow * np.sin(phase) + noise[1, : part.size]
        part["ux_code"] = noise[2, : part.size]
        part["uy_code"] = noise[3, : part.size]
        began = time.process_time()
        writer.push(part)
        between = time.process_time()
        for first in range(0, part.size, 4_096):  # as they come to the recorder
            pyramid.push(part[first : first + 4_096].copy())
        spent["pyramid"] += time.process_time() - between
        spent["both"] += time.process_time() - began
    writer.close()
    pyramid.close()
    return spent
