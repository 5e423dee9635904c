"""A campaign of a few short runs, as a table."""

from copy import deepcopy
from typing import Any

from hil.sweeping.campaign import Campaign
from hil.sweeping.plan import Plan, plan_of
from hil.toml.reading import parse_table

Table = dict[str, Any]

SMALL: Table = {
    "name": "small",
    "scenario": "s-slow",
    "bench": "s-slow",
    "seeds": 2,
    "rows_per_file": 3,
    "fixed": {
        "scenario.rate": {"kind": "constant", "rate_rad_s": 1.0},
        "bench.loop.duration_s": 0.4,
        "bench.loop.settle_s": 0.1,
    },
    "vary": [
        {
            "key": "scenario.sense.noise_V",
            "also": ["bench.device.sense.noise_V"],
            "values": [3e-5, 9e-4],
        },
        {
            "key": "scenario.truth.stiffness_N_per_m[0]",
            "name": "kxx",
            "low": 0.99,
            "high": 1.01,
            "levels": 2,
            "relative": True,
        },
    ],
}
"""8 runs of 1600 samples in files of 3: the last file is not full."""


def small(**changes: Any) -> Table:
    """SMALL with other keys at its top."""
    return deepcopy(SMALL) | changes


RUNS: Table = small(seeds=4)
"""16 runs."""


def plan(table: Table | None = None) -> Plan:
    """The plan of such a table."""
    return plan_of(parse_table(SMALL if table is None else table, Campaign, "small.toml"), "small.toml")
