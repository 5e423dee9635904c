"""`python -m evaluation.undeclared [generate|evaluate|all]`: see the package.

Killed at any moment it goes on where it was when the same command is given again: records and answers are kept in the
folder.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.jobs import done_by
from evaluation.undeclared.judging import Judgement, judge
from evaluation.undeclared.page import write_page
from evaluation.undeclared.population import DRAW, population
from evaluation.undeclared.record import SAMPLES
from evaluation.undeclared.summary import summarise
from evaluation.undeclared.tracing import done
from hil.errors import told_to_user
from hil.records.atomic import write_text

FOLDER = Path("runs/undeclared")
TARGET = Path("runs/undeclared.json")
PAGE = Path("evaluation/results")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 good, 2 bad input, 130 interrupted."""
    options = _parsed(arguments)
    orders = [order for order in population(options.n, options.draw) if options.only in order.name]
    making, tracing = options.what != "evaluate", options.what != "generate"
    if not making:
        orders = [order for order in orders if (options.folder / order.name / "truth.json").exists()]
    if not orders:
        print(
            f"evaluation.undeclared: {options.folder}: no record of this draw is there; `generate` makes them, and "
            "--only takes what a name contains",
            file=sys.stderr,
        )
        return 2
    one = partial(
        done, folder=options.folder, samples=options.samples, making=making, tracing=tracing, keep=options.keep
    )
    try:
        begin = time.monotonic()
        for number, (order, future) in enumerate(done_by(options.jobs, one, orders), 1):
            said = f"{number}/{len(orders)} {order.name}: {future.result()}, {time.monotonic() - begin:.0f} s"
            print(said, file=sys.stderr, flush=True)
        if tracing:
            judged = [judgement_of(options.folder / order.name) for order in orders]
            summary = summarise(judged)
            write_text(options.out, json.dumps(summary, indent=1) + "\n")
            write_page(options.page, summary, judged)
            for category in ("single", "clean", "outside", "double", "calm", "never"):
                print(category, json.dumps(summary[category]))
    except KeyboardInterrupt:
        print("evaluation.undeclared: interrupted; the same command goes on", file=sys.stderr)
        return 130
    except (ValueError, OSError, MemoryError) as error:
        if (told := told_to_user(error)) is None:
            raise
        print(f"evaluation.undeclared: {told}", file=sys.stderr)
        return 2
    return 0


def judgement_of(place: Path) -> Judgement:
    """Of the record in that folder, and of its answer, if it has one."""
    said = place / "diagnosis.json"
    truth = json.loads((place / "truth.json").read_text())
    return judge(truth, json.loads(said.read_text()) if said.exists() else None)


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
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
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
