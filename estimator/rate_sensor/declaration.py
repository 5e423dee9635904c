"""What an effect of a rate sensor is: a place in the chain from rate to volts, coefficients, and how it acts there.

The base model is V = V0 + S Ω.  The chain around it, in the order in which a signal meets it:

    reference rate → REFERENCE → RATE → S·(Ω + CHARACTERISTIC) + V0 + SURROUNDINGS → LIMIT → volts
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from estimator.rate_sensor.record import SensorRecord
from estimator.scaling import Array
from estimator.trace.output_error import Term


class Stage(IntEnum):
    """Where in the chain an effect acts; the chain is run in this order."""

    REFERENCE = 0  # of the reference rate itself: what it shows is not what the sensor felt
    RATE = 1  # on the rate, before it becomes a voltage
    CHARACTERISTIC = 2  # added to the rate: the static curve
    SURROUNDINGS = 3  # added to the volts
    LIMIT = 4  # on the volts


@dataclass(frozen=True)
class Range:
    """What the data sheet declares and a record is scaled by: rate [rad/s], volts of that rate; unit: what stands for
    the volt where the output has a unit of its own.
    """

    rate: float
    volts: float
    unit: str = "V"


Act = Callable[[Array, Array, SensorRecord, Range], Array]
Transient = Callable[[Array, SensorRecord], Array]
Starts = Callable[[SensorRecord, Range], tuple[tuple[float, ...], ...]]


@dataclass(frozen=True, kw_only=True)
class Effect(Term):
    """One thing that the straight line lacks.

    act(signal, coefficients, record, range) → the signal after the stage (REFERENCE, RATE, LIMIT), or what is added to
    it (CHARACTERISTIC, SURROUNDINGS); lower, upper: bounds of the coefficients given the record and the range;
    starts: first values to refine from, several where the cost has several minima; needs: "time" (a record with a
    sampling interval), "temperature" (its channel) or nothing; transient(coefficients, record) → (n, k): what a
    response adds that was not at rest where a stretch of the record begins, a column for each number that is unknown;
    reaches(coefficients) → s, how far back a reading hangs on the rate, and on nothing before; path_dependent: a curve
    all the same.
    """

    name: str
    stage: Stage
    act: Act
    bounds: Callable[[SensorRecord, Range], tuple[tuple[float, float], ...]]
    source: str
    starts: Starts = lambda record, declared: ((0.0,),)
    needs: str = ""
    transient: Transient | None = None
    reaches: Callable[[Array], float] | None = None
    path_dependent: bool = False

    @property
    def is_curve(self) -> bool:
        """Whether it is of the static curve."""
        return (self.stage in (Stage.CHARACTERISTIC, Stage.LIMIT) and not self.needs) or self.path_dependent

    @property
    def is_linear(self) -> bool:
        """Whether the volts are in proportion to its one coefficient."""
        return self.stage in (Stage.CHARACTERISTIC, Stage.SURROUNDINGS) and not self.coefficients[0].positive

    def applies_to(self, record: SensorRecord) -> bool:
        """Whether the record has what the effect needs in order to be seen."""
        if self.needs == "time":
            return record.step is not None
        if self.needs == "temperature":
            return record.temperature is not None
        return True
