"""Passes over a record that were made already: a search asks for many of them again."""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from estimator.trace.likelihood import Evaluation

T = TypeVar("T")

PASSES = 24
"""Of one record or part of it, the last that were made: a search comes back to a model within a round."""


class Kept:
    """Parts of a record, and passes over it by what they depend on."""

    def __init__(self) -> None:
        self._parts: dict[Hashable, Any] = {}
        self._passes: dict[tuple[Hashable, bool], Evaluation] = {}

    def part(self, rows: Hashable, cut: Callable[[], T]) -> T:
        """The part of these rows, cut the first time."""
        if rows not in self._parts:
            self._parts[rows] = cut()
        found: T = self._parts[rows]
        return found

    def evaluation(self, key: Hashable, derivatives: bool, make: Callable[[], Evaluation]) -> Evaluation:
        """The pass, made where it is not among the last ones; one with derivatives has all of one without."""
        found = self._passes.get((key, True)) or self._passes.get((key, derivatives))
        if found is None:
            found = self._passes[key, derivatives] = make()
            for oldest in list(self._passes)[:-PASSES]:
                self._passes.pop(oldest, None)
        return found
