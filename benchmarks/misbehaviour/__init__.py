"""A hundred and forty ways for a board to misbehave, over a pty, each with what the pages promise of the bench."""

import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.misbehaviour.judging import Case, broken, build, cases, run
from benchmarks.row import Row, Say

SIDE_BY_SIDE = 3


def rows(say: Say) -> list[Row]:
    """All cases; each that is not met is said with what was seen."""
    every = cases()
    unmet = 0
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        program = build(Path(place))

        def judged(item: tuple[str, Case]) -> tuple[str, list[str]]:
            name, case = item
            return name, broken(case, run(program, name, case, Path(place) / name))

        for done, (name, told) in enumerate(pool.map(judged, every.items()), start=1):
            unmet += bool(told)
            say(f"{done} of {len(every)}, {name}: {'; '.join(told) or 'met'}")
    return [Row("cases", len(every), "1"), Row("cases not as the pages promise", unmet, "1")]
