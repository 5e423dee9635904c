"""`python -m evaluation.gate`: the gate of `hil sweep --baseline` on real sweeps in lockstep.

Twenty sweeps with other seeds are held against a baseline: none may be blamed.  Then one whose sense noise is a fifth
larger than the bench file declares is: its innovation ratio is to be found, with about that change.  Last each gated
figure of each of the twenty is made a fifth larger in the table, and how often that is found is counted: it tells how
small a regression these few runs can show, for fresh seeds and for those of the baseline.
"""

import argparse
import tempfile
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute

import hil
from hil.sweeping.baseline import GATED, Change, changes
from hil.sweeping.campaign import Campaign

SWEEPS, PLANTED, NOISE_V = 20, 1.2, 8.9e-5
CAMPAIGN: dict[str, Any] = {
    "name": "gate",
    "scenario": "s-slow",
    "bench": "s-slow",
    "seeds": 8,
    "fixed": {
        "scenario.rate": {"kind": "constant", "rate_rad_s": 1.0},
        "scenario.sense.noise_V": NOISE_V,
        "bench.loop.duration_s": 2.0,
        "bench.loop.settle_s": 0.5,
    },
    "vary": [{"key": "scenario.rate.rate_rad_s", "values": [0.5, 3.0]}],
}


def swept(folder: Path, seed: int, noise: float = 1.0) -> pa.Table:
    """The rows of a sweep; `noise`: the board's over what the bench file declares."""
    fixed = CAMPAIGN["fixed"] | {"scenario.sense.noise_V": noise * NOISE_V}
    return hil.sweep(CAMPAIGN | {"seed": seed, "fixed": fixed}, out=folder / f"{seed}-{noise}").table


def blamed(new: pa.Table, old: pa.Table) -> list[Change]:
    """What the gate calls worse."""
    return [one for one in changes(new, old, Campaign.model_validate(CAMPAIGN)) if one.worse]


def larger(table: pa.Table, figure: str) -> pa.Table:
    """The table with a figure a fifth larger."""
    grown = pyarrow.compute.multiply(table[figure], PLANTED)
    return table.set_column(table.column_names.index(figure), figure, grown)


def main() -> None:
    """Sweep, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of the baseline; the sweeps have those behind it")
    first = parser.parse_args().seed
    with tempfile.TemporaryDirectory() as aside:
        folder = Path(aside)
        baseline = swept(folder, first)
        fresh = [swept(folder, first + 1 + number) for number in range(SWEEPS)]
        wrong = [[one.line for one in blamed(table, baseline)] for table in fresh]
        print(f"without a regression: {sum(map(bool, wrong))} of {SWEEPS} sweeps blamed")
        for line in chain.from_iterable(wrong):
            print(f"  {line}")
        for told, seed in (("fresh seeds", first + 1 + SWEEPS), ("the baseline's seeds", first)):
            found = blamed(swept(folder, seed, PLANTED), baseline)
            print(f"board noise {PLANTED} × what is declared, {told}: {'found' if found else 'missed'}")
            for one in found:
                print(f"  {one.line}")
        print(f"one figure {PLANTED} ×, found in sweeps with fresh seeds; with the baseline's seeds")
        for figure in GATED:
            if all(value is None for value in baseline[figure].to_pylist()):
                continue
            hits = sum(any(one.figure == figure for one in blamed(larger(table, figure), baseline)) for table in fresh)
            paired = any(one.figure == figure for one in blamed(larger(baseline, figure), baseline))
            print(f"  {figure:<30} {hits:2} of {SWEEPS}; {'found' if paired else 'missed'}")


if __name__ == "__main__":
    main()
