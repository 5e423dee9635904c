"""Numbers in tracing that someone has set and that may change a verdict: value, unit and why it is that.

What follows from mathematics (quantiles, what a Hann window does), from a declaration, or only bounds a figure or its
cost is no threshold and stands where it is used.
"""

from dataclasses import asdict, dataclass, field
from typing import TypeVar

T = TypeVar("T")


def _set(value: T, unit: str, reason: str) -> T:
    # A field in the guise of its value, so that a checker sees the type of the value.
    made: T = field(default=value, metadata={"unit": unit, "reason": reason})
    return made


@dataclass(frozen=True)
class Fitness:
    """Whether a record can be traced at all."""

    fewest_samples: int = _set(150, "samples", "Fewer cannot be divided into a part to choose by and one to score on.")
    fewest_cycles: float = _set(5.0, "cycles", "Fewer tell no damping from a stiffness.")
    moves: float = _set(3.0, "× the declared noise", "A channel below this shows nothing but noise.")
    lost_share: float = _set(0.5, "share of the samples", "With more lost, the gaps and not the device are fitted.")
    end_samples: int = _set(
        20, "samples", "At the end of the scale fewer repeat a peak by chance; before it so many are a parabola."
    )
    end_codes: int = _set(
        5, "values of the converter", "A sine has more samples at so many below its top than at it, and turns there."
    )
    clipped_share: float = _set(1e-3, "share of the samples", "So few move no coefficient by its interval.")


@dataclass(frozen=True)
class Candidates:
    """What is watched for, and at which frequencies and thresholds."""

    strongest: int = _set(
        3, "kinds, lines or peaks", "Beyond the strongest few the next round sees them, once those are carried."
    )
    damping_ratio: float = _set(0.005, "ζ", "A start for modes of silicon where the response does not tell.")
    off_resonance: float = _set(
        1e-3, "of the drive's power", "A drive with less elsewhere tells a mode's frequency by nothing."
    )
    least_damping_ratio: float = _set(1e-4, "ζ", "A response that tells less is narrower than its own bins.")
    beside_peak: int = _set(8, "bins to either side", "So many bins of the response belong to the peak of one mode.")
    shares: tuple[float, ...] = _set(
        (0.02, 0.1, 0.3, 0.6, 0.8, 0.95), "of the largest drive or displacement", "From one to the next, a fit goes on."
    )
    dead_band: tuple[float, ...] = _set(
        (0.02, 0.06, 0.15, 0.5),
        "of the drive's rms",
        "The same for a dead band, whose likelihood has a top at each kink.",
    )
    segments: int = _set(8, "segments in the record at least", "A coherence of fewer segments is one by itself.")


@dataclass(frozen=True)
class Criterion:
    """What decides a verdict."""

    chance: float = _set(
        1e-3, "probability", "Of a check to fail where all is well, of a name where nothing is, of a motion in noise."
    )
    floor: float = _set(1.1, "× the noise floor", "So much a complete model may leave: what the word says.")
    disturbance: float = _set(
        0.02, "share of the innovation's power", "A hundredth of the rms, beside what the noise is known to."
    )
    prior: float = _set(4.5, "declared deviations", "A bench file is not right to the letter.")
    tie: float = _set(9.0, "of 2 ln L", "Odds of a hundred to one, below which two accounts are told together.")
    part: float = _set(0.5, "share of a power", "What holds less of a record or of a residual is not what that is of.")


@dataclass(frozen=True)
class Start:
    """How a pass over a record begins."""

    cycles: float = _set(2.0, "cycles", "They show a motion to some percent, or that there is none.")
    memories: float = _set(3.0, "memories of the observer", "A start from declared values has decayed to a twentieth.")
    longest_memory: float = _set(1.0, "s", "An observer of longer memory has settled its motion by then.")
    most: int = _set(4, "1 / share of the record", "A short record is not scored by its last part alone.")


@dataclass(frozen=True)
class Symmetries:
    """When what was named obeys a symmetry of the equations."""

    broken: float = _set(0.1, "of a coefficient", "What departs by less may be a second, smaller cause.")


@dataclass(frozen=True)
class Floor:
    """The noise that a complete model would leave."""

    upper: float = _set(4.0, "1 / share of the sampling rate", "The floor is read from the upper half of the spectrum.")


@dataclass(frozen=True)
class Spectrum:
    """Lines of the residual and the floor around them."""

    orders: int = _set(5, "multiples of the resonance", "Laws of motion up to the fifth power show there.")
    sideband: float = _set(
        1.0 / 8.0, "resonances", "So near to a multiple a line is what modulation and rotation make of that."
    )


@dataclass(frozen=True)
class Thresholds:
    """All of them, by what they are for."""

    fitness: Fitness = field(default_factory=Fitness)
    candidates: Candidates = field(default_factory=Candidates)
    criterion: Criterion = field(default_factory=Criterion)
    start: Start = field(default_factory=Start)
    symmetries: Symmetries = field(default_factory=Symmetries)
    floor: Floor = field(default_factory=Floor)
    spectrum: Spectrum = field(default_factory=Spectrum)


def values(thresholds: Thresholds) -> dict[str, dict[str, int | float | tuple[float, ...]]]:
    """By group and name."""
    return asdict(thresholds)


THRESHOLDS = Thresholds()
"""Those that tracing goes by.  A module reads them when it is imported or later: a trial of others puts them
here, in a process of its own, before any other module of tracing is imported."""
