"""Keys of a file by their place in it: `sense.noise_V`, `truth.stiffness_N_per_m[0]`, `rate.segment[1].rate_rad_s`."""

import re
from collections.abc import Sequence
from typing import Any

from hil.errors import InputError
from hil.toml.reading import suggestion

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
