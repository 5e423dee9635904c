"""`python -m benchmarks.challenge secret|make|score|baselines|tracer`: see the package."""

import argparse
import sys
import warnings
from pathlib import Path

from benchmarks.challenge.baselines import entries
from benchmarks.challenge.draw import make_secret, orders, read_secret
from benchmarks.challenge.task import make_set, overall, score
from benchmarks.challenge.tracer import entry


def main() -> int:
    """Run the command line; returns the exit code."""
    options = _parsed()
    if options.verb == "secret":
        make_secret(options.file)
        print(f"{options.file}: keep it, and keep it from entrants")
    elif options.verb == "make":
        secret = read_secret(options.secret) if options.secret else f"practice {options.draw}".encode()
        print(f"{len(make_set(options.folder, orders(options.count, secret)))} records in {options.folder}")
    elif options.verb == "score":
        scores = score(options.answers, options.set / "sealed", options.set / "open")
        for one in scores:
            print(f"{one.name} {one.over_noise:10.2f}")
        print(f"overall   {overall(scores):10.2f} times the noise")
    elif options.verb == "baselines":
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="sklearn")  # that a fit ended early
            entries(options.set / "open", options.answers)
    else:
        for name, found in entry(options.set / "open", options.answers).items():
            print(f"{name} {found.verdict} {' + '.join(found.effects)}", flush=True)
    return 0


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.challenge", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    hidden = verbs.add_parser("secret", help="a new secret for the keeper of a set")
    hidden.add_argument("file", type=Path)
    making = verbs.add_parser("make", help="draw a set: FOLDER/open for entrants, FOLDER/sealed kept back")
    making.add_argument("folder", type=Path)
    making.add_argument("--count", type=int, default=12)
    drawn = making.add_mutually_exclusive_group(required=True)
    drawn.add_argument("--secret", type=Path, help="file of the keeper's secret")
    drawn.add_argument("--draw", type=int, help="any number: a set for practice, which everybody can make")
    scoring = verbs.add_parser("score", help="compare answers with what was kept back")
    scoring.add_argument("answers", type=Path)
    scoring.add_argument("set", type=Path, help="the folder with open and sealed")
    baseline = verbs.add_parser("baselines", help="answers of the linear model and of the network, below ANSWERS")
    tracing = verbs.add_parser("tracer", help="answers of this bench's tracer and observer, in ANSWERS")
    for one in (baseline, tracing):
        one.add_argument("set", type=Path, help="the folder with open")
        one.add_argument("answers", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
