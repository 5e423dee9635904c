"""Small changes to the modules that make the bench's word: does a test fail for each of them?

A change that no test notices, a survivor, is either no change of what is promised, or a promise that is not tested.

    python -m benchmarks.mutants [MODULE …] [--sample 20] [--seed 1] [--line N …] [--tests FILE …] [--slow]
    python -m benchmarks.mutants --named

MODULE is one of those in `benchmarks.mutants.belong`, or any other with `--tests`. The module is changed in memory, for
the tests and for every process that they start; no file is touched. The tests are those of the module that are neither
`slow` nor `realtime`; slow ones too where `belong` names single tests, and with `--slow` all. A trial that takes much
longer than the tests without a change counts as noticed. `--named` tries those of `benchmarks.mutants.named` instead,
which were once not noticed.
"""

from typing import NamedTuple

from benchmarks.mutants.belong import TESTS
from benchmarks.mutants.named import NAMED
from benchmarks.mutants.trial import Trials
from benchmarks.row import Row, Say

SAMPLE, SEED = 20, 1


class Found(NamedTuple):
    """How many changes were tried, and how many of them no test noticed."""

    tried: int
    left: int


def rows(say: Say) -> list[Row]:
    """Of a sample of each module, how many changes no test notices."""
    table = []
    for module in TESTS:
        found = survivors(module, TESTS[module], say)
        table += [
            Row(f"{module}: changes tried", found.tried, "1"),
            Row(f"{module}: changes that no test notices", found.left, "1"),
        ]
    return table


def named_survivors(say: Say) -> Found:
    """Try each of the named changes, and say what no test notices."""
    left = 0
    for one in NAMED:
        survives = Trials(one.module, list(one.tests)).survives(one.mutant())
        left += survives
        say(f"{'not noticed' if survives else 'noticed'}: {one.says} ({one.module})")
    say(f"named: {len(NAMED)} tried, {left} left")
    return Found(len(NAMED), left)


def survivors(
    module: str,
    tests: list[str],
    say: Say,
    *,
    sample: int = SAMPLE,
    seed: int = SEED,
    lines: frozenset[int] = frozenset(),
    slow: bool = False,
) -> Found:
    """Try a sample of the changes to a module, or all of those on `lines`, and say each that no test notices."""
    trials = Trials(module, tests, slow=slow)
    chosen = trials.chosen(sample, seed, lines)
    say(f"{module}: {len(chosen)} of {trials.possible} changes, {trials.seconds:.1f} s of tests each")
    left = 0
    for mutant in chosen:
        if trials.survives(mutant):
            left += 1
            say(f"{trials.path}:{mutant.line}: {mutant.words}")
    say(f"{module}: {len(chosen)} tried, {left} left")
    return Found(len(chosen), left)
