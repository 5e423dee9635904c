"""What the core is handed of an observer, by name."""

from typing import NamedTuple

from estimator.core.layout import Floats, Ints, Record


class Arrays(NamedTuple):
    """An observer's own arrays, scaled: live, for those who call the core with them.

    settings, memory, rows and trims (1,) are records (`estimator.core.layout`); active (k,) which constants are
    estimated; intensity (k,) of their random walks, the square of the density: variance per unit of time; prior:
    variance with which the initial value is measured again for what was forgotten of it, 0 for none; spread: its
    initial variance; initial value; table (angles, phases, n, axes) the stationary gains; x (states + constants,);
    p, c (n, n) the covariance assumed by the gain and the one that estimates have under it.
    """

    settings: Record
    active: Ints
    intensity: Floats
    prior: Floats
    spread: Floats
    initial: Floats
    table: Floats
    x: Floats
    p: Floats
    c: Floats
    memory: Record
    rows: Record
    trims: Record
