"""`python -m benchmarks [NAME …]`: measure figures and keep them in runs/bench.json.

Each NAME replaces its own rows in the file and leaves the others; `make bench` is `--speed`. The pages of figures are
docs/results.md and evaluation/results; what the tracer finds is measured by `evaluation`.
"""

import argparse
import importlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from hil.errors import InputError
from hil.records.atomic import write_text

BENCHMARKS = {
    "how fast": {
        "speed": "a step of 7, 11, 13 states, of 13 with effects, beside C, filterpy and NumPy",
        "plug_in": "the bench's own estimator as a compiled plug-in beside the one built in: cost of a sample",
        "force_mode": "paced force mode at 4 kHz beside a bare read and write",
        "reference": "the turnaround of paced force mode with a commercial gyro recorded beside it, and without",
        "stream": "gain mode over a pty in real time: 100, 250 kS/s, and as fast as it goes",
        "trace_time": "traces of a million samples and of many kinds of 10^5; the scan that closes a run",
        "day": "the data sheet of a day at 1 kHz, six axes; DAY_S=N for another length",
    },
    "how right": {
        "angle_slope": "angle per rotation in lockstep: force mode, gain mode, latencies",
        "variants": "the observers of 7 and 11 states; a tabulated gain beside the EKF",
        "consistency": "coverage, NEES and Cramér–Rao ratio over 400 seeds of S-slow and S-classic",
        "s_classic": "the rate of S-classic at amplitude / noise = 20 beside its Cramér–Rao bound",
        "uncertainty": "errors of the angle beside its U over 60 drawn devices of three plants",
        "verdicts": "340 runs on emulated devices, verdict and uncertainty beside the truth; an hour",
        "comparison": "the observers beside the prior art on 12 drawn records; ten minutes",
    },
    "what lasts": {
        "endurance": "10^9 samples in lockstep, gone on with after any kill; an hour and more",
        "campaigns": "a campaign killed ten times and gone on with; by 1, 2, 4 workers",
        "service": "what a page costs, from its key to SAFE, kills of service and loop; an hour",
    },
}
KNOWN = {name: what for group in BENCHMARKS.values() for name, what in group.items()}
SPEED = ("speed", "force_mode")
TARGET = Path("runs/bench.json")


def main() -> int:
    """Run what was asked for; the exit code: 1 where something could not be measured."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line has it
    groups = [
        "\n".join([f"{group}:", *(f"  {name:<12} {what}" for name, what in names.items())])
        for group, names in BENCHMARKS.items()
    ]
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        epilog="\n\n".join(groups),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", nargs="*", help="which, from the list below")
    parser.add_argument("--speed", action="store_true", help=f"{', '.join(SPEED)}, and their figures as one table")
    parser.add_argument("--out", type=Path, default=TARGET, help=f"default {TARGET}")
    options = parser.parse_args()
    if not (options.name or options.speed):
        parser.error(f"which? one or more of {', '.join(KNOWN)}")
    unknown = set(options.name) - set(KNOWN)
    if unknown:
        parser.error(f"no benchmark {', '.join(sorted(unknown))}; known: {', '.join(KNOWN)}")
    failed = []
    for name in options.name or SPEED:
        begin = time.monotonic()
        print(f"{name}: {KNOWN[name]}", file=sys.stderr, flush=True)
        module = importlib.import_module(f"benchmarks.{name}")
        try:
            rows = module.rows(lambda line: print(f"  {line}", file=sys.stderr, flush=True))
        except InputError as error:  # a machine that is too busy for a run on the wall clock, say
            print(f"{name}: not measured: {error}", file=sys.stderr, flush=True)
            failed.append(name)
            keep(options.out, name, [])  # what stands there is of another run
            continue
        keep(options.out, name, [{**row._asdict(), "name": f"{name}: {row.name}"} for row in rows])
        for row in rows:
            beside = "" if row.ratio is None else f"   {row.ratio:.3g} × {row.peer}"
            print(f"{name}: {row.name:<56} {row.value:>14.7g} {row.unit}{beside}", flush=True)
        print(f"{name}: {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    if options.speed:
        print(table(json.loads(options.out.read_text())))
    if failed:
        print(f"not measured: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def table(rows: list[dict[str, Any]]) -> str:
    """The figures about speed that have a peer, as a table in Markdown."""
    lines = ["| what | | over | ratio | quartiles |", "|---|---|---|---|---|"]
    for row in rows:
        if row["name"].partition(":")[0] in SPEED and row["ratio"] is not None:
            spread = "" if row.get("low") is None else f"{row['low']:.2f} to {row['high']:.2f}"
            lines.append(
                f"| {row['name'].partition(': ')[2]} | {row['value']:.3g} {row['unit']} | {row['peer']} "
                f"| {row['ratio']:.3g} | {spread} |"
            )
    return "\n".join(lines)


def keep(path: Path, name: str, rows: list[dict[str, object]]) -> None:
    """Replace the rows of one benchmark in the file."""
    old = json.loads(path.read_text()) if path.exists() else []
    others = [row for row in old if not row["name"].startswith(f"{name}: ")]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(others + rows, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    sys.exit(main())
