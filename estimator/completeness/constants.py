"""The constants that a calibration declares, all of them a little off at once, as one account of a record.

A device as its bench file declares it has every gain, angle and delay off by some part of its standard uncertainty.  No
single effect explains such a record, and the one that comes nearest need not be there at all.  So the model that others
are held against has all of them, as well known as they are declared, and they are told where the record shows them.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from estimator.completeness.information import Information, Posterior
from estimator.effects.catalogue import effect_for
from estimator.scaling import Array
from estimator.settings import Device


class Off(NamedTuple):
    """Constants that a record shows to be off, by effect with the places of each among the coefficients of `found`,
    which is what the record leaves of them beside all the others; evidence: twice the log-odds against none being off.
    """

    places: Mapping[str, slice]
    found: Posterior
    evidence: float


def calibrated_effects(declared: Mapping[str, float], names: Collection[str], device: Device) -> tuple[str, ...]:
    """Those of the named effects of which every coefficient has a declared standard deviation, by symbol, SI."""
    return tuple(name for name in names if all(declared.get(s, 0.0) > 0.0 for s in symbols_of(name, device)))


def symbols_of(name: str, device: Device) -> list[str]:
    """Of an effect's coefficients."""
    return [c.name.partition(":")[0] for c in effect_for(name, device.axes, device.own)[1].coefficients]


def off(
    information: Information, names: Collection[str], declared: Mapping[str, float], device: Device, least: float
) -> Off | None:
    """What the record shows of the constants: all of them together, or one effect where the others being as they are
    declared is more probable; None where twice the log-odds against none being off are below `least`.
    """
    symbols = {name: symbols_of(name, device) for name in names}
    accounts: list[tuple[str, ...]] = [(name,) for name in names]
    if len(names) > 1:
        accounts.append(tuple(names))

    def evidence(account: Collection[str]) -> float:
        known = {symbol: declared[symbol] for name in account for symbol in symbols[name]}
        return 2.0 * information.posterior(known).log_evidence

    best = max(accounts, key=evidence, default=())
    if not best or not evidence(best) > least:
        return None
    joint = information.posterior({symbol: declared[symbol] for name in names for symbol in symbols[name]})
    found = joint.part([joint.symbols.index(symbol) for name in best for symbol in symbols[name]])
    ends = np.cumsum([len(symbols[name]) for name in best]).tolist()
    places = {name: slice(end - len(symbols[name]), end) for name, end in zip(best, ends, strict=True)}
    return Off(places, found, evidence(best))


def shares(terms: Array, places: Mapping[str, slice]) -> dict[str, float]:
    """The root of a sum of terms (k,), divided among effects so that the squares of their parts add up to that sum."""
    positive = np.maximum(terms, 0.0)
    whole = float(positive.sum())
    scale = max(float(terms.sum()), 0.0) / whole if whole > 0.0 else 0.0
    return {name: float(np.sqrt(scale * positive[of].sum())) for name, of in places.items()}
