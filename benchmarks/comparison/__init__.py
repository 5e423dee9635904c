"""The observers beside the prior art: sense offsets and 2 % mismatch, the same records.

Devices like S-slow are drawn (orientation of the mismatch, damping, offsets, where the pattern begins, how the board
turns), which no setting of any method was chosen on.  Each is run in lockstep by the shipped bench file, and every
method reads its record as `hil compare` has it; the methods that close the loop themselves do so on the same device
with the same seed.  Three cases: as shipped; without dither, so that nothing but the control turns the pattern; with
ten times the noise.  Results are kept in runs/comparison, one file a record; what is there is not run again.  The page
evaluation/results/comparison.md is written anew.
"""

from pathlib import Path

from benchmarks.comparison.page import write_page
from benchmarks.comparison.population import CASES, RECORDS, Planned
from benchmarks.comparison.summary import Pooled, pooled, rivalry
from benchmarks.row import Row, Say
from hil.records.methods import Methods, load_methods, save_methods

KEPT = Path("runs/comparison")
PAGE = Path("evaluation/results/comparison.md")
OURS = "13 states and the rotation, EKF"


def rows(say: Say) -> list[Row]:
    """Angle and rate error of every method, rms over the records of a case, over that of the bench's own observer."""
    figures: list[Row] = []
    tables: dict[str, list[Pooled]] = {}
    for case in CASES:
        found = []
        for device in range(RECORDS[case]):
            found.append(one(Planned(case, device)))
            say(f"{case}, record {device + 1} of {RECORDS[case]}")
        tables[case] = pooled(found)
        ours = next(row for row in tables[case] if row.name == OURS)
        for row in tables[case]:
            what = f"{case}: {row.name}"
            figures.append(Row(f"{what}, angle error rms", row.angle, "rad", OURS, row.angle / ours.angle))
            if row.rate is not None and ours.rate:
                figures.append(Row(f"{what}, rate error rms", row.rate, "rad/s", OURS, row.rate / ours.rate))
        for name, (rival, ratio, low, high) in rivalry(found, OURS).items():
            figures.append(Row(f"{case}: {name} ({rival}) over {OURS}, angle error", ratio, "1"))
            figures.append(Row(f"{case}: {name}, least and largest of a record", low, "1", "largest", high))
    write_page(PAGE, tables, {case: len(found) for case, found in _kept().items()})
    return figures


def one(planned: Planned) -> Methods:
    """The methods on one record; from its file if it was run before."""
    kept = KEPT / f"{planned.name}.json"
    if kept.exists():
        return load_methods(kept)
    found = planned.compared()
    kept.parent.mkdir(parents=True, exist_ok=True)
    save_methods(kept, found)
    return found


def _kept() -> dict[str, list[Methods]]:
    return {case: [one(Planned(case, device)) for device in range(RECORDS[case])] for case in CASES}
