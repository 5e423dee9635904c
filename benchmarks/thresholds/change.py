"""Other thresholds: half and double of each, and putting them in the place of those that are."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from estimator import thresholds
from estimator.thresholds import Thresholds, each

SIDES = ("half", "double")

Changes = Mapping[str, str]
"""By `group.name`, which side."""


def changed(value: Any, side: str) -> Any:
    """Half or double of a threshold, in the sense of the package's description."""
    factor = 0.5 if side == "half" else 2.0
    if isinstance(value, tuple):
        return tuple(max(round(factor * one), 1) if isinstance(one, int) else factor * one for one in value)
    if isinstance(value, int):
        return max(round(factor * value), 1)
    if 0.5 < value < 1.0:
        return 1.0 - factor * (1.0 - value)
    if 1.0 < value < 1.5:
        return 1.0 + factor * (value - 1.0)
    return factor * value


def with_changes(changes: Changes) -> Thresholds:
    """The thresholds as they are but for these."""
    whole = thresholds.Thresholds()
    known = {one.name: one.value for one in each(whole)}
    for name, side in changes.items():
        group, _, own = name.partition(".")
        members: Any = replace(getattr(whole, group), **{own: changed(known[name], side)})
        whole = replace(whole, **{group: members})
    return whole


def install(changes: Changes) -> None:
    """For this process, which must not have imported anything else of tracing yet."""
    thresholds.THRESHOLDS = with_changes(changes)


def in_place(changes: Changes) -> None:
    """In those that this process goes by, all others as they are: seen by whatever is not read on import."""
    whole = thresholds.THRESHOLDS
    for one in each(with_changes(changes)):
        group, _, own = one.name.partition(".")
        object.__setattr__(getattr(whole, group), own, one.value)


def watch(seen: set[str]) -> None:
    """From now on every threshold that is read in this process is put into `seen`, as `group.name`."""
    whole = thresholds.THRESHOLDS
    known = {one.name for one in each(whole)}
    groups = {type(getattr(whole, name)): name for name in {name.partition(".")[0] for name in known}}
    for kind, group in groups.items():
        kind.__getattribute__ = _noting(group, known, seen)


def _noting(group: str, known: set[str], seen: set[str]) -> Any:
    def read(self: object, name: str) -> Any:
        if f"{group}.{name}" in known:
            seen.add(f"{group}.{name}")
        return object.__getattribute__(self, name)

    return read
