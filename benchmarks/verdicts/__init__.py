"""Whether a run's own verdict can be trusted: `hil run` on hundreds of emulated devices, its word beside the truth.

240 devices with one effect that nobody declared (the population of `make undeclared`), 60 clean ones, 40 extremes.
`python -m benchmarks.verdicts` goes on where it was interrupted: each run leaves one line in runs/verdicts.jsonl.
"""

from benchmarks.row import Row, Say


def rows(say: Say) -> list[Row]:
    """The campaign that figures are published of."""
    from benchmarks.verdicts.campaign import FOLDER, campaign
    from benchmarks.verdicts.population import DRAW, population
    from benchmarks.verdicts.summary import summarise

    return summarise(campaign(population(DRAW), FOLDER, jobs=3, say=say))
