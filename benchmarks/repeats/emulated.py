"""Repeats of the laboratory's records: another force, another noise, the same device."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.laboratory.kinds import KINDS
from benchmarks.laboratory.pools import POOLS
from benchmarks.laboratory.rows import diagnosed, pooled
from benchmarks.repeats.agreement import Repeated
from hil.records.diagnosis import Coefficient, Diagnosis

SEED = 23
REPEATS = 12

Answer = tuple[int, str, dict[str, tuple[float, float, float] | None]]
"""Kind, its name, and by coefficient value, half width and truth, None where it was not named."""


def tasks() -> list[tuple[int, int]]:
    """Kind and repeat of each record, those of one kind not in a row."""
    return [(kind, repeat) for repeat in range(REPEATS) for kind in range(len(KINDS) + len(POOLS))]


def answer(task: tuple[int, int], work: Path) -> Answer:
    """One record made, imported and traced."""
    number, repeat = task
    rng = np.random.default_rng((SEED, number, repeat))
    place = work / f"{number}-{repeat}"
    place.mkdir()
    if number < len(KINDS):
        kind = KINDS[number](rng)
        return number, kind.name, _found(diagnosed(kind, place)[0], kind.truth, {})
    pool = POOLS[number - len(KINDS)](rng)
    return number, pool.name, _found(pooled(pool, place)[0], pool.truth, pool.slopes)


def _found(
    diagnosis: Diagnosis, truth: Mapping[str, float], slopes: Mapping[str, float]
) -> dict[str, tuple[float, float, float] | None]:
    known = {symbol: one for effect in diagnosis.effects for symbol, one in effect.coefficients.items()}
    tilts = {one.name: one.per_unit for one in diagnosis.dependences}
    return {symbol: _numbers(known.get(symbol), true) for symbol, true in truth.items()} | {
        f"slope of {name}": _numbers(tilts.get(name), true) for name, true in slopes.items()
    }


def _numbers(one: Coefficient | None, true: float) -> tuple[float, float, float] | None:
    if one is None or one.value is None or one.ci95[0] is None or one.ci95[1] is None:
        return None
    return one.value, 0.5 * (one.ci95[1] - one.ci95[0]), true


def gathered(answers: list[Answer]) -> list[Repeated]:
    """By kind and coefficient."""
    made = []
    for number in sorted({one[0] for one in answers}):
        mine = [one for one in answers if one[0] == number]
        for symbol in mine[0][2]:
            given = [one[2][symbol] for one in mine]
            there = [one for one in given if one is not None]
            if there:
                values, halves, truths = zip(*there, strict=True)
                made.append(Repeated(mine[0][1], symbol, values, halves, truths[0], len(given) - len(there)))
    return made
