"""`python -m evaluation.undeclared [generate|evaluate|all]`: see the package.

Both parts go on where they were interrupted: records and answers are kept in the folder.
"""

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from evaluation.undeclared.judging import judge
from evaluation.undeclared.page import write_page
from evaluation.undeclared.population import DRAW, Order, population
from evaluation.undeclared.record import SAMPLES, make
from evaluation.undeclared.summary import summarise
from evaluation.undeclared.tracing import trace_all
from hil.records.atomic import write_text

FOLDER = Path("runs/undeclared")
TARGET = Path("runs/undeclared.json")
PAGE = Path("docs/results")


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.undeclared", description=__doc__)
    parser.add_argument("what", choices=["generate", "evaluate", "all"], nargs="?", default="all")
    parser.add_argument("--n", type=int, default=480, help="about how many records (default 480)")
    parser.add_argument("--draw", type=int, default=DRAW, help=f"another number, other records (default {DRAW})")
    parser.add_argument("--only", default="", help="only records whose name contains this")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--samples", type=int, default=SAMPLES, help=f"of each record (default {SAMPLES})")
    parser.add_argument("--folder", type=Path, default=FOLDER, help=f"of the records (default {FOLDER})")
    parser.add_argument("--keep", action="store_true", help="keep answers of an estimator that has changed since")
    parser.add_argument("--out", type=Path, default=TARGET, help=f"figures (default {TARGET})")
    parser.add_argument("--page", type=Path, default=PAGE, help=f"folder of the page (default {PAGE})")
    options = parser.parse_args()
    orders = [order for order in population(options.n, options.draw) if options.only in order.name]
    if options.what != "evaluate":
        generate(orders, options.folder, options.samples, options.jobs)
    if options.what != "generate":
        places = [options.folder / order.name for order in orders]
        evaluate([place for place in places if (place / "truth.json").exists()], options)
    return 0


def evaluate(places: list[Path], options: argparse.Namespace) -> None:
    """Trace, judge, and write the figures and the page."""
    trace_all(places, options.jobs, options.keep, say)
    judged = []
    for place in places:
        truth = json.loads((place / "truth.json").read_text())
        said = place / "diagnosis.json"
        judged.append(judge(truth, json.loads(said.read_text()) if said.exists() else None))
    summary = summarise(judged)
    write_text(options.out, json.dumps(summary, indent=1) + "\n")
    write_page(options.page, summary, judged)
    for category in ("single", "clean", "outside", "double", "calm", "never"):
        print(category, json.dumps(summary[category]))


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
