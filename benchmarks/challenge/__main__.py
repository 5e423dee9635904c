"""`python -m benchmarks.challenge make|score|baselines`: see the package."""

import argparse
import sys
import warnings
from pathlib import Path

from benchmarks.challenge.baselines import entries
from benchmarks.challenge.task import make_set, overall, score


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.challenge", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    making = verbs.add_parser("make", help="draw a set: FOLDER/open for entrants, FOLDER/sealed kept back")
    making.add_argument("folder", type=Path)
    making.add_argument("--count", type=int, default=24)
    making.add_argument("--draw", type=int, required=True, help="a number that only the keeper of the set knows")
    scoring = verbs.add_parser("score", help="compare answers with what was kept back")
    scoring.add_argument("answers", type=Path)
    scoring.add_argument("set", type=Path, help="the folder with open and sealed")
    baseline = verbs.add_parser("baselines", help="answers of the linear model and of the network, below ANSWERS")
    baseline.add_argument("set", type=Path)
    baseline.add_argument("answers", type=Path)
    options = parser.parse_args()
    if options.verb == "make":
        print(f"{len(make_set(options.folder, options.count, options.draw))} records in {options.folder}")
    elif options.verb == "score":
        scores = score(options.answers, options.set / "sealed", options.set / "open")
        for one in scores:
            print(f"{one.name} {one.over_noise:10.2f}")
        print(f"overall   {overall(scores):10.2f} times the noise")
    else:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="sklearn")  # that a fit ended early
            entries(options.set / "open", options.answers)
    return 0


if __name__ == "__main__":
    sys.exit(main())
