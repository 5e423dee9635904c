"""Which drive acted while a sample was missing: decided by the samples that follow.

A lost sample takes the echo of its drive with it. The board was told one, but it held the one before if that frame was
lost as well. The difference shows in one sample no more than its noise, yet it turns the pattern by a milliradian that
would be taken for rotation. So for a while after a gap a second observer goes on as if the last drive had been held; if
the samples find that far likelier, it was.
"""

import copy
import math

from estimator.observer import Observer
from hil.wire.sense import SenseRow

SAMPLES = 40
"""After a gap until it is decided; two cycles of a device sampled 20 times a cycle."""

MARGIN = 2.0 * math.log(99.0)
"""By which the second hypothesis must win, in units of the squared innovation: a frame in a hundred gets lost."""


class Hindsight:
    """Beside one observer, whose state it replaces when the other hypothesis wins."""

    def __init__(self, observer: Observer) -> None:
        self._told, self._held = observer, copy.deepcopy(observer)
        self._left = 0
        self._gain = 0.0

    @property
    def undecided(self) -> bool:
        """Whether it is to be told of each sample."""
        return self._left > 0

    def gap(self, ux: float, uy: float) -> None:
        """A sample is missing; the last drive echoed was `ux`, `uy`. Call it before the observer predicts over it."""
        self._decide()
        self._held.adopt(self._told)
        self._held.obey(self._told)
        self._held.tick(math.nan, math.nan, ux, uy)
        self._left, self._gain = SAMPLES, 0.0

    def saw(self, row: SenseRow) -> None:
        """The observer has had its tick with `row`."""
        if self._left:
            self._held.tick(row[1], row[2], row[3], row[4])
            self._gain += self._told.deviance - self._held.deviance
            self._left -= 1
            if not self._left:
                self._decide()

    def forget(self) -> None:
        """The motion is found anew: there is nothing to decide."""
        self._left, self._gain = 0, 0.0

    def _decide(self) -> None:
        if self._gain > MARGIN:
            self._told.adopt(self._held, commands=False)
        self.forget()
