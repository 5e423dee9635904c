"""Gain mode in real time over a pty: S-modern at 5 kHz, the board a process of its own on wall time, blocks of 500
samples; and the highest rate at which nothing is lost for half a minute.

Load is time on a processor over time, of the host's loop and of its recorder, as the run itself reports it, and of the
emulated board from /proc.  A rate is held when no sample is missing, no block was dropped and the watchdog never
tripped.
"""

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from benchmarks.lockstep import bench_of
from benchmarks.row import Row, Say
from hil.bench import examples
from hil.boards.emulation import emulator
from hil.progress import Progress
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run

EXAMPLE = "s-modern-5k"
RATES_HZ = (100e3, 250e3)
SECONDS = 60.0
FASTEST_HZ = (700e3, 600e3, 500e3, 450e3, 400e3, 350e3, 300e3)
FASTEST_SECONDS = 30.0


class Streamed(NamedTuple):
    """What came of one run; `board` is the load of the emulated board."""

    result: Result
    board: float

    @property
    def held(self) -> bool:
        """Whether nothing was lost."""
        counters = self.result.counters
        return self.result.complete and self.result.lost == 0 and counters["rearmed"] == counters["board_dropped"] == 0


def rows(say: Say) -> list[Row]:
    """All rates in turn, the fastest that holds last."""
    figures = []
    for rate_Hz in RATES_HZ:
        streamed = stream(rate_Hz, SECONDS)
        say(told(rate_Hz, streamed))
        figures += figures_of(rate_Hz, SECONDS, streamed)
    for rate_Hz in FASTEST_HZ:
        streamed = stream(rate_Hz, FASTEST_SECONDS)
        say(told(rate_Hz, streamed))
        if streamed.held:
            figures.append(Row(f"highest rate held for {FASTEST_SECONDS:g} s", rate_Hz / 1e3, "kS/s"))
            figures += figures_of(rate_Hz, FASTEST_SECONDS, streamed)
            break
    return figures


def figures_of(rate_Hz: float, seconds: float, streamed: Streamed) -> list[Row]:
    """Losses, loads and ledger of one run."""
    result, label = streamed.result, f"{rate_Hz / 1e3:g} kS/s, {seconds:g} s"
    assert result.load is not None
    assert result.ledger_us is not None
    figures = [
        Row(f"{label}, samples lost", result.lost, "1"),
        Row(f"{label}, blocks dropped by the board", result.counters["board_dropped"], "1"),
        Row(f"{label}, host's loop", 100.0 * result.load.loop, "% of a core"),
        Row(f"{label}, host's recorder", 100.0 * result.load.recorder, "% of a core"),
        Row(f"{label}, board", 100.0 * streamed.board, "% of a core"),
        Row(f"{label}, matrices late", result.counters["board_late"], "1"),
    ]
    for stage, times in result.ledger_us.model_dump().items():
        figures += [Row(f"{label}, {stage} {key}", value, "µs") for key, value in times.items()]
    return figures


def told(rate_Hz: float, streamed: Streamed) -> str:
    """A line on one run."""
    result = streamed.result
    load = 0.0 if result.load is None else result.load.loop
    return (
        f"{rate_Hz / 1e3:g} kS/s: {result.lost} lost, {result.counters['board_dropped']} blocks dropped, "
        f"loop {load:.0%}, board {streamed.board:.0%} of a core"
    )


def stream(rate_Hz: float, seconds: float) -> Streamed:
    """One run at a sampling rate."""
    bench = bench_of(
        EXAMPLE,
        device={"sample_rate_Hz": rate_Hz},
        loop={"clock": "paced", "duration_s": seconds, "settle_s": 0.0, "seed": 1},
    )
    with scenario_at(rate_Hz) as scenario:
        loads: list[tuple[float, float]] = []  # wall time and the board's processor time, while samples come
        with emulator(scenario) as board:

            def watch(progress: Progress) -> None:
                if progress.stage == "run":
                    loads.append((time.monotonic(), processor_time(board.process.pid)))

            folder = run(RunRequest(bench, board.url), scenario.parent, progress=watch).folder
        assert folder is not None
        result = RunFolder(folder).result
        assert result is not None
        (begin, before), (end, after) = loads[0], loads[-1]
        return Streamed(result, (after - before) / (end - begin))


@contextmanager
def scenario_at(rate_Hz: float) -> Iterator[Path]:
    """The example's scenario at a sampling rate, in a folder that goes afterwards."""
    text = examples.find("scenario", EXAMPLE).read_text(encoding="utf-8")
    given = "sample_rate_Hz = 100000.0"
    assert given in text
    with tempfile.TemporaryDirectory() as place:
        scenario = Path(place) / "board.scenario.toml"
        scenario.write_text(text.replace(given, f"sample_rate_Hz = {rate_Hz}"), encoding="utf-8")
        yield scenario


def processor_time(process: int) -> float:
    """User and system time of a process so far, in seconds."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
