"""The clock of an emulated board in paced runs over a pty, as found beside what its scenario says.

The board's clock is this machine's, made to run fast; so its offset is known as well.
"""

import tempfile
from pathlib import Path

from benchmarks.lockstep import bench_of
from benchmarks.row import Row, Say
from hil.bench import examples
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run

EXAMPLES = ("s-slow", "s-modern-5k")
SECONDS = 30.0
SKEW = 1e-4


def rows(say: Say) -> list[Row]:
    """Force mode at 4 kHz, gain mode at 100 kS/s."""
    figures = []
    for example in EXAMPLES:
        bench = bench_of(example, loop={"clock": "paced", "duration_s": SECONDS, "settle_s": 0.0, "seed": 1})
        with tempfile.TemporaryDirectory() as place:
            scenario = Path(place) / "board.scenario.toml"
            text = examples.find("scenario", example).read_text(encoding="utf-8")
            assert "[faults]" not in text
            scenario.write_text(f"{text}\n[faults]\nclock_skew = {SKEW}\n", encoding="utf-8")
            folder = run(RunRequest(bench, f"pty:{scenario}"), Path(place), progress=lambda _: None).folder
            assert folder is not None
            result = RunFolder(folder).result
        assert result is not None
        assert result.board_clock is not None
        say(f"{example}: {result.board_clock.line}")
        found = result.board_clock.relation
        assert found is not None
        figures += [
            Row(f"{example}, skew found less {1e6 * SKEW:g} ppm", found.skew_ppm - 1e6 * SKEW, "ppm"),
            Row(f"{example}, its interval, ±", found.skew_uncertainty_ppm, "ppm"),
            Row(f"{example}, offset error", 1e-3 * (found.offset_ns - SKEW * found.at_host_ns), "µs"),
            Row(f"{example}, its uncertainty, ±", 1e-3 * found.offset_uncertainty_ns, "µs"),
            Row(f"{example}, shortest round trip", found.round_trip_us, "µs"),
            Row(f"{example}, late", 100.0 * result.late / result.samples, "%"),
        ]
    return figures
