"""`python -m benchmarks.verdicts`: see the package."""

import argparse
import json
import sys
from pathlib import Path

from benchmarks.verdicts.campaign import FOLDER, campaign, told
from benchmarks.verdicts.population import DRAW, SAMPLES, population
from benchmarks.verdicts.summary import summarise


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdicts", description=__doc__)
    parser.add_argument("--draw", type=int, default=DRAW, help=f"another number, other devices (default {DRAW})")
    parser.add_argument("--share", type=float, default=1.0, help="of the 340 runs (default all)")
    parser.add_argument("--only", default="", help="only runs whose name contains this")
    parser.add_argument("--jobs", type=int, default=3, help="processes (default 3)")
    parser.add_argument("--samples", type=int, default=SAMPLES, help=f"of each run (default {SAMPLES})")
    parser.add_argument("--folder", type=Path, default=FOLDER, help=f"of the lines (default {FOLDER})")
    parser.add_argument("--out", type=Path, help="figures as JSON")
    options = parser.parse_args()
    orders = [order for order in population(options.draw, options.share) if options.only in order.name]
    lines = campaign(
        orders, options.folder, jobs=options.jobs, samples=options.samples,
        say=lambda said: print(said, file=sys.stderr, flush=True),
    )  # fmt: skip
    for line in lines:
        u, error = line.get("angle_expanded_rad"), line.get("error_rms_rad")
        good = line.get("verdict") == "good"
        if (good and u and error and error > u) or (not good and line["category"] == "clean") or "failed" in line:
            print(told(line))
    for row in summarise(lines):
        print(f"{row.name:<40} {row.value:>10.4g} {row.unit}")
    if options.out:
        options.out.write_text(json.dumps([row._asdict() for row in summarise(lines)], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
