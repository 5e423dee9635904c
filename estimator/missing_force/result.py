"""What is said of a missing force: the force along the record and its form, SI."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis import Interval
from estimator.scaling import Array


@dataclass(frozen=True)
class FormTerm:
    """A term of the form: as each axis has it ("q³", "r² v"), whether it is sensed and does not push, its coefficients
    with their 95 % intervals by name (`x`, `y`, or `both`; of a line with `cos` or `sin` before), the number inside
    it that came from the record (a gap, a limit, a frequency), by name, and what one of each coefficient adds along x
    and y in the grammar of [effects.custom]: none for a term that has a memory.
    """

    form: str
    sense: bool
    coefficients: Mapping[str, Interval]
    threshold: Mapping[str, Interval]
    laws: Mapping[str, tuple[str, str]]


@dataclass(frozen=True)
class Form:
    """The form that was proposed for a missing force; no terms: none was worth its price.

    left: share of the force that it leaves on the part held out, rms over rms; before, after: innovation there over
    what is expected of noise, without and with it.
    """

    terms: tuple[FormTerm, ...]
    left: float
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class MissingForce:
    """The force per mass that the model lacks, along the samples from `first` of a record on.

    time (n,) s; position, velocity, drive (force per mass), force, left: (n, axes) SI; deviation, left_deviation
    (axes,) m/s² standard deviations of force and of what the form leaves; temperature (n,) °C, None without one; there
    (n,): whether the sample was not lost; split: of these samples, how many were used to choose.
    """

    first: int
    time: Array
    position: Array
    velocity: Array
    drive: Array
    force: Array
    deviation: Array
    left: Array
    left_deviation: Array
    temperature: Array | None
    there: NDArray[np.bool_]
    split: int
    form: Form
