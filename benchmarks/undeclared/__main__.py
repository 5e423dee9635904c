"""`python -m benchmarks.undeclared generate|evaluate`: see the package."""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from benchmarks.undeclared.population import Order, population
from benchmarks.undeclared.record import SAMPLES, make

FOLDER = Path("runs/undeclared")


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.undeclared", description=__doc__)
    parser.add_argument("what", choices=["generate", "evaluate"], nargs="?", default="generate")
    parser.add_argument("--n", type=int, default=480, help="about how many records (default 480)")
    parser.add_argument("--only", default="", help="only records whose name contains this")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--samples", type=int, default=SAMPLES, help=f"of each record (default {SAMPLES})")
    parser.add_argument("--folder", type=Path, default=FOLDER, help=f"of the records (default {FOLDER})")
    options = parser.parse_args()
    orders = [order for order in population(options.n) if options.only in order.name]
    generate(orders, options.folder, options.samples, options.jobs)
    return 0


def generate(orders: list[Order], folder: Path, samples: int, jobs: int) -> None:
    """Make the records that are not there yet."""
    begin = time.monotonic()
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(make, order, folder, samples): order for order in orders}
        for done, future in enumerate(as_completed(waiting), 1):
            future.result()
            say(f"{done}/{len(orders)} {waiting[future].name}, {time.monotonic() - begin:.0f} s")


def say(line: str) -> None:
    """Progress, on standard error."""
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
