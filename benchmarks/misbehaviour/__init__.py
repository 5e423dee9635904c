"""A hundred and forty ways for a board to misbehave, each with what the pages promise of the bench.

`python -m benchmarks.misbehaviour --help` has the options: on a pty or on CAN, some cases, what an earlier run left.
"""

import tempfile
from pathlib import Path

from benchmarks.misbehaviour.campaign import campaign
from benchmarks.misbehaviour.judging import cases
from benchmarks.row import Row, Say

SIDE_BY_SIDE = 3


def rows(say: Say) -> list[Row]:
    """All cases on a pty; each that is not met is said with what was seen."""
    with tempfile.TemporaryDirectory() as place:
        outcomes = campaign(cases(), "pty", Path(place), SIDE_BY_SIDE, say)
    unmet = sum(bool(outcome.told) for outcome in outcomes.values())
    return [Row("cases", len(outcomes), "1"), Row("cases not as the pages promise", unmet, "1")]
