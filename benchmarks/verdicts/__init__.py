"""Whether a run's own verdict can be trusted: `hil run` on hundreds of emulated devices, its word beside the truth.

240 devices with one effect that nobody declared (the population of `make undeclared`), 60 clean ones, 40 extremes.  It
goes on where it was interrupted: each run leaves one line in runs/verdicts.  VERDICTS_SHARE takes a share of each kind.
"""

import os

from benchmarks.row import Row, Say
from benchmarks.verdicts.campaign import FOLDER, campaign
from benchmarks.verdicts.population import DRAW, population
from benchmarks.verdicts.summary import summarise


def rows(say: Say) -> list[Row]:
    """The campaign that figures are published of."""
    orders = population(DRAW, float(os.environ.get("VERDICTS_SHARE", "1")))
    return summarise(campaign(orders, FOLDER, jobs=3, say=say))
