"""What the verbs need of memory for a long record: a run in gain mode at 100 kS/s in lockstep, then each of them on it.

MEMORY_S is its length in seconds of bench time, 60 without it; an hour takes some 40 minutes and 50 GB of disk, of
which 33 GB are the truth; MEMORY_DIR is where. Of each process, sampled ten times a second: its high-water mark (VmHWM,
which counts pages of mapped libraries as well), and how much of it is its own (RssAnon). The peer is what is promised.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.row import Row, Say

PROMISED_MB = 1000.0
_EVERY_S = 0.1


def rows(say: Say) -> list[Row]:
    """A run, and every verb that goes through its record."""
    seconds = float(os.environ.get("MEMORY_S", "60"))
    figures: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="memory-", dir=os.environ.get("MEMORY_DIR")) as name:
        place = Path(name)
        link = ["--link", "inproc:s-modern-5k", "--clock", "lockstep", "--duration", f"{seconds:g}"]
        figures += measured(say, place, "run", "s-modern-5k", *link, "--truth", "truth.arrow")
        (folder,) = (place / "runs").iterdir()
        for verb, *more in (
            ("check",),
            ("score", "--truth", "truth.arrow"),
            ("export", "--to", "parquet", "-o", "out.parquet"),
            ("export", "--to", "csv", "-o", "out.csv"),
            ("replay", "--bench", "s-modern-5k"),
        ):
            figures += measured(say, place, verb, str(folder), *more)
            for made in place.glob("out.*"):
                made.unlink()
    return figures


def measured(say: Say, place: Path, *arguments: str) -> list[Row]:
    """`hil` with these arguments, run in `place`: a row for each of its processes."""
    begin = time.monotonic()
    peaks: dict[tuple[int, str], tuple[float, float]] = {}
    with (place / "said.txt").open("wb") as said:
        host = subprocess.Popen(
            [sys.executable, "-m", "hil", *arguments],
            cwd=place, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT,
        )  # fmt: skip
        while host.poll() is None:
            for process in family(host.pid):
                if (now := memory_MB(process)) is not None:
                    key, mark, own = now
                    before = peaks.get((process, key), (0.0, 0.0))
                    peaks[process, key] = max(mark, before[0]), max(own, before[1])
            time.sleep(_EVERY_S)
    words = (place / "said.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines() or [""]
    verb = " ".join([arguments[0], *(word for word in arguments if word in ("csv", "parquet"))])
    say(f"{verb}: {time.monotonic() - begin:.0f} s, exit code {host.returncode}; {words[-1][:100]}")
    return [
        row
        for (_, name), (mark, own) in peaks.items()
        for row in (
            Row(f"{verb}, {name}: high-water mark", mark, "MB", "promised", mark / PROMISED_MB),
            Row(f"{verb}, {name}: its own", own, "MB"),
        )
    ]


def family(process: int) -> list[int]:
    """A process and all below it."""
    found = [process]
    for member in found:  # which grows meanwhile
        try:
            found += map(int, Path(f"/proc/{member}/task/{member}/children").read_text().split())
        except OSError:
            continue
    return found


def memory_MB(process: int) -> tuple[str, float, float] | None:
    """What a process runs, its high-water mark so far, and what it holds of its own; None of one that has ended."""
    try:
        status = dict(line.split(":", 1) for line in Path(f"/proc/{process}/status").read_text().splitlines())
        command = Path(f"/proc/{process}/cmdline").read_text().split("\0")
        mark, own = (int(status[key].split()[0]) * 1024e-6 for key in ("VmHWM", "RssAnon"))
    except (OSError, KeyError, ValueError):
        return None
    module = command[command.index("-m") + 1] if "-m" in command else command[0]
    return module, mark, own
