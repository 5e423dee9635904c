"""`python -m benchmarks.mutants`: see the package."""

import argparse
import sys

from benchmarks import mutants
from benchmarks.mutants.belong import TESTS


def main() -> int:
    """Try what was asked for; exit code 1 where a change is not noticed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.mutants",
        description=mutants.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("module", nargs="*", help=f"default all of {', '.join(TESTS)}")
    parser.add_argument("--tests", nargs="+", metavar="FILE", help="instead of those that belong to the module")
    parser.add_argument("--sample", type=int, default=mutants.SAMPLE, help=f"changes, default {mutants.SAMPLE}")
    parser.add_argument("--seed", type=int, default=mutants.SEED, help=f"of the sample, default {mutants.SEED}")
    parser.add_argument("--line", type=int, nargs="+", default=[], help="every change on these lines, no sample")
    parser.add_argument("--slow", action="store_true", help="those marked slow and realtime, too")
    parser.add_argument("--named", action="store_true", help="those that were once not noticed, nothing else")
    options = parser.parse_args()
    if options.named:
        return int(mutants.named_survivors(lambda line: print(line, flush=True)).left > 0)
    left = 0
    for module in options.module or TESTS:
        tests = options.tests or TESTS.get(module)
        if tests is None:
            parser.error(f"no tests are known for {module}; name them with --tests")
        found = mutants.survivors(
            module,
            tests,
            lambda line: print(line, flush=True),
            sample=options.sample,
            seed=options.seed,
            lines=frozenset(options.line),
            slow=options.slow,
        )
        left += found.left
    return int(left > 0)


if __name__ == "__main__":
    sys.exit(main())
