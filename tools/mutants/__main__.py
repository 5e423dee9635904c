"""`python -m tools.mutants MODULE --tests FILE …`: small changes to a module; does a test fail for each of them?

A change that no test notices, a survivor, is either no change of what is specified, or of something that no test
holds. The module is changed in memory, for the tests and for every process that they start; no file is touched. Tests
marked slow or realtime are left out, unless single ones are named or --slow is given. A trial that takes much longer
than the tests without a change counts as noticed. Exit code 1 where a change is not noticed.
"""

import argparse
import sys

from tools.mutants.trial import Trials


def main() -> int:
    """Try what was asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.mutants", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("module", help="as it is imported: hil.verdict.angle")
    parser.add_argument("--tests", nargs="+", metavar="FILE", required=True, help="those that say what it promises")
    parser.add_argument("--sample", type=int, default=20, help="changes, default 20")
    parser.add_argument("--seed", type=int, default=1, help="of the sample, default 1")
    parser.add_argument("--line", type=int, nargs="+", default=[], help="every change on these lines, no sample")
    parser.add_argument("--slow", action="store_true", help="those marked slow and realtime, too")
    options = parser.parse_args()
    trials = Trials(options.module, options.tests, slow=options.slow)
    chosen = trials.chosen(options.sample, options.seed, frozenset(options.line))
    print(f"{len(chosen)} of {trials.possible} changes, {trials.seconds:.1f} s of tests each", flush=True)
    left = 0
    for mutant in chosen:
        if trials.survives(mutant):
            left += 1
            print(f"{trials.path}:{mutant.line}: {mutant.words}", flush=True)
    print(f"{len(chosen)} tried, {left} left")
    return int(left > 0)


if __name__ == "__main__":
    sys.exit(main())
