"""The data sheet of a day: six axes at 1 kHz, as a user asks for it, `hil characterise FILE`, page included.

The record is made first, of 24-bit counts as a STIM300 sends them: white noise, a bias that walks, one sample missing.
Of the verb's process: wall, processor time, and the most memory it held. DAY_S is another length in seconds, DAY_DIR
where (a day takes 5 GB of disk). It is the command line and not the estimator alone: reading, fit and page are in it.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from math import radians
from pathlib import Path

import numpy as np

from benchmarks.row import Row, Say
from hil.records.layout import Column
from hil.records.rates import rates_layout
from hil.records.stream import BlockWriter

RATE_HZ, AXES = 1000.0, "uvwxyz"
STEP_RAD_S = radians(2.0**-14)
WHITE, WALK = 40.0, 0.002  # counts: of a sample, and of the bias from one sample to the next
MUST_S, MUST_MB = 60.0, 1000.0
_BLOCK = 1 << 20


def rows(say: Say) -> list[Row]:
    """Make the day, and its data sheet."""
    seconds = float(os.environ.get("DAY_S", "86400"))
    with tempfile.TemporaryDirectory(prefix="day-", dir=os.environ.get("DAY_DIR")) as name:
        place = Path(name)
        samples = round(seconds * RATE_HZ)
        write(place / "day.arrow", samples)
        say(f"{samples} samples of {len(AXES)} axes, {(place / 'day.arrow').stat().st_size / 1e9:.2f} GB")
        begin = time.monotonic()
        command = [sys.executable, "-m", "hil", "characterise", "day.arrow", "--name", "day", "--json"]
        with (place / "said.json").open("wb") as said:
            verb = subprocess.Popen(command, cwd=place, stdout=said, stdin=subprocess.DEVNULL)
            _, status, used = os.wait4(verb.pid, 0)
        wall_s = time.monotonic() - begin
        sheet = json.loads((place / "said.json").read_text())
        walks = [row for row in sheet["rows"] if row["figure"] == "angle_random_walk"]
        true = WHITE * STEP_RAD_S / RATE_HZ**0.5
        inside = sum(row["low"] <= true <= row["high"] for row in walks)
        say(f"exit code {os.waitstatus_to_exitcode(status)}; load {os.getloadavg()[0]:.1f}")
    processor_s = used.ru_utime + used.ru_stime
    return [
        Row("wall", wall_s, "s", "must", wall_s / MUST_S),
        Row("processor", processor_s, "s", "must", processor_s / MUST_S),
        Row("most memory", used.ru_maxrss * 1024e-6, "MB", "must", used.ru_maxrss * 1024e-6 / MUST_MB),
        Row("angle random walk within its interval", inside, f"of {len(walks)}"),
    ]


def write(path: Path, samples: int) -> None:
    """The record, by blocks."""
    chance = np.random.default_rng(1)
    layout = rates_layout(
        [Column(f"rate_{axis}_code", "i4", "rad/s", STEP_RAD_S) for axis in AXES], tick_rate_Hz=RATE_HZ, device="a day"
    )
    bias = np.zeros(len(AXES))
    with BlockWriter(path, layout) as writer:
        for first in range(0, samples, _BLOCK):
            n = min(_BLOCK, samples - first)
            table = np.zeros(n, layout.dtype)
            table["tick"] = np.arange(first, first + n) + (first > samples // 2)  # one sample is missing
            table["latency_us"] = -1
            for k, axis in enumerate(AXES):
                walk = bias[k] + np.cumsum(WALK * chance.standard_normal(n, np.float32), dtype=float)
                table[f"rate_{axis}_code"] = np.rint(WHITE * chance.standard_normal(n, np.float32) + walk)
                bias[k] = walk[-1]
            writer.push(table)
