"""The whole bench once over: an emulated board in its own process, the loop in real time, score, report."""

import tempfile
from pathlib import Path
from typing import Any

from hil import examples
from hil.bench import load_bench, override
from hil.progress import Progress, Watcher

EXAMPLE = "s-slow"
GAIN_MODE_EXAMPLE = "s-modern-5k"


def demo(
    out: Path,
    *,
    name: str = "demo",
    duration_s: float | None = None,
    seed: int | None = None,
    gain_mode: bool = False,
    progress: Watcher,
) -> Path:
    """Run the example in paced real time over a pty and return the run folder, made below ``out``. In gain mode it is
    a 5 kHz gyro at 100 kS/s, whose board closes the loop itself with matrices from the host.

    The board writes its truth into a temporary file, which only the score reads, once the run is over.
    `hil.errors.InputError` or `hil.wire.errors.WireError` when board or bench cannot be had.
    """
    from hil.loop.run import run
    from hil.report.page import write_report
    from hil.score import score

    example = GAIN_MODE_EXAMPLE if gain_mode else EXAMPLE
    path = examples.find("bench", example)
    changes: dict[str, Any] = {"name": name, "clock": "paced", "seed": seed}
    if duration_s is not None:
        changes["duration_s"] = duration_s
    bench = override(load_bench(path), {"loop": changes}, f"{path} with the options given")
    with tempfile.TemporaryDirectory() as aside:
        truth = Path(aside) / "truth.arrow"
        link = f"pty:{examples.find('scenario', example)}"
        folder = run(bench, link, out, truth=truth, progress=progress).folder
        assert folder is not None  # only a dry run leaves none
        progress(Progress("score and report", 0, 0))
        score(folder, truth)
        write_report(folder, truth=truth)
    return folder
