"""The points of a campaign: for each varied key the share of its distribution, and the value that this is."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.sweeping.campaign import Campaign, Vary

Floats = npt.NDArray[np.float64]


def points(campaign: Campaign) -> Floats:
    """Shares (points, keys) in [0, 1): of a grid the middle of each level, the last key's changing fastest."""
    count = len(campaign.vary)
    if campaign.design.kind == "grid":
        levels = [_levels(one) for one in campaign.vary]
        total = math.prod(levels)
        index = np.stack(np.unravel_index(np.arange(total), levels), 1) if levels else np.zeros((1, 0))
        return np.asarray((index + 0.5) / np.array(levels, dtype=float))
    from scipy.stats import qmc

    wanted = campaign.design.points
    assert wanted is not None
    generator = np.random.default_rng(campaign.seed)
    if campaign.design.kind == "sobol":
        return np.asarray(qmc.Sobol(count, seed=generator).random_base2(wanted.bit_length() - 1))
    return np.asarray(qmc.LatinHypercube(count, seed=generator).random(wanted))


def value_of(one: Vary, share: float) -> Any:
    """What a key takes at a share of its distribution."""
    if one.values is not None:
        return one.values[min(int(share * len(one.values)), len(one.values) - 1)]
    if one.mean is not None and one.sd is not None:
        from scipy.special import ndtri

        return float(one.mean + one.sd * ndtri(min(max(share, 1e-12), 1.0 - 1e-12)))
    assert one.low is not None
    assert one.high is not None
    if one.levels is not None:
        share = min(int(share * one.levels), one.levels - 1) / (one.levels - 1)
    if share in (0.0, 1.0):  # the ends exactly
        return one.high if share else one.low
    if one.scale == "log":
        return math.exp(math.log(one.low) + share * (math.log(one.high) - math.log(one.low)))
    return one.low + share * (one.high - one.low)


def seed_of(campaign: Campaign, point: int, repeat: int) -> int:
    """Of a run: the same for the same campaign seed, point and repetition, whatever else there is."""
    state = np.random.SeedSequence([campaign.seed, point, repeat]).generate_state(1, np.uint64)
    return int(state[0] >> np.uint64(1))


def _levels(one: Vary) -> int:
    assert one.values is not None or one.levels is not None
    return len(one.values) if one.values is not None else int(one.levels or 0)


def how_many(campaign: Campaign) -> int:
    """Runs of a campaign."""
    levels: Sequence[int] = [_levels(one) for one in campaign.vary] if campaign.design.kind == "grid" else ()
    return math.prod(levels) * (campaign.design.points or 1) * campaign.seeds
