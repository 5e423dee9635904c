"""The points of a campaign: for each varied key the share of its distribution, and the value that this is."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.sweeping.campaign import Campaign, Vary
from hil.toml.reading import suggestion

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
    levels: Sequence[int] = [_levels(one) for one in campaign.vary] if campaign.design.kind == "grid" else ()
    return math.prod(levels) * (campaign.design.points or 1) * campaign.seeds


Table = dict[str, Any]
_PART = re.compile(r"([A-Za-z0-9_:-]+)((?:\[\d+\])*)")


def parts_of(key: str) -> list[str | int]:
    """Names and positions on the way to a key.  Raises InputError for what is no key.

    >>> parts_of("truth.stiffness_N_per_m[0]")
    ['truth', 'stiffness_N_per_m', 0]
    """
    parts: list[str | int] = []
    for piece in key.split("."):
        if (found := _PART.fullmatch(piece)) is None:
            raise InputError(f"{key}: no key; write it as sense.noise_V or truth.stiffness_N_per_m[0]")
        parts.append(found[1])
        parts += [int(position) for position in re.findall(r"\d+", found[2])]
    return parts


def value_at(table: Table, key: str) -> Any:
    """What stands at a key, None where nothing does.  Raises InputError where the way there is none."""
    here: Any = table
    for part in parts_of(key):
        if isinstance(part, int):
            here = _entry(here, part, key)
        elif isinstance(here, dict):
            here = here.get(part)
        else:
            raise InputError(f"{key}: {part!r} is looked for in what is no table")
        if here is None:
            return None
    return here


def put(table: Table, key: str, value: Any, *, strict: bool) -> None:
    """Set a key; strict: it must be there already.  Raises InputError with what there is instead."""
    *way, last = parts_of(key)
    here: Any = table
    for part in way:
        if isinstance(part, int):
            here = _entry(here, part, key)
            continue
        if not isinstance(here, dict):
            raise InputError(f"{key}: {part!r} is looked for in what is no table")
        if part not in here:
            if strict:
                raise InputError(f"{key}: no {part!r} there; {suggestion(part, _names(here))}")
            here[part] = {}
        here = here[part]
    if isinstance(last, int):
        _entry(here, last, key)
    elif not isinstance(here, dict):
        raise InputError(f"{key}: {last!r} is looked for in what is no table")
    elif strict and last not in here:
        raise InputError(f"{key}: no such key; {suggestion(last, _names(here))}")
    here[last] = value


def plain(value: Any) -> Any:
    """Tables and lists that can be changed, without the sorts that a model makes of them."""
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value


def _names(table: Table) -> Sequence[str]:
    return list(table)


def _entry(here: Any, position: int, key: str) -> Any:
    if not isinstance(here, list):
        raise InputError(f"{key}: [{position}] of what is no list")
    if position >= len(here):
        raise InputError(f"{key}: [{position}] of a list of {len(here)}; positions are counted from 0")
    return here[position]
