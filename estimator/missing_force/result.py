"""What is said of a missing force: the force along the record and its form, SI."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis import Interval
from estimator.scaling import Array


@dataclass(frozen=True)
class FormTerm:
    """A term of the form: how it is written, whether it is sensed and does not push, its coefficients with their 95 %
    intervals, the number inside it that came from the record (a gap, a limit, a frequency), by name.

    Of a law of the library ("p² v", "|r| r") coefficients are named by axis (`x`, `y`, or `both`; of a wave with `cos`
    or `sin` before), and `laws` has what one of each adds along x and y in the grammar of [effects.custom].  Else
    `effect` is the name of one of the catalogue, whose coefficients these are.
    """

    form: str
    sense: bool
    coefficients: Mapping[str, Interval]
    threshold: Mapping[str, Interval]
    laws: Mapping[str, tuple[str, str]]
    effect: str = ""


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
