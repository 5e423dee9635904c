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
    fewest_free_cycles: float = _set(5.0, "cycles", "A free response cannot be made longer.")
    fewest_driven_cycles: float = _set(
        100.0, "cycles", "A driven gyro can run longer, and its envelope is to be seen to move."
    )
    moves: float = _set(3.0, "× the declared noise", "A channel below this shows nothing but noise.")
    rest: float = _set(2.0, "cycles", "Eight samples at least, which tell noise from motion; a mass stops within one.")
    lost_share: float = _set(0.5, "share of the samples", "With more lost, the gaps and not the device are fitted.")
    end_samples: int = _set(
        20, "samples", "At the end of the scale fewer repeat a peak by chance; before it so many are a parabola."
    )
    end_excess: float = _set(
        5.0, "× the samples just below the end", "A sine has a few times more samples at its top than beside it."
    )
    beside_end: int = _set(5, "values of the converter", "These are what the count at the end is compared with.")
    beyond_end: float = _set(
        2.0, "codes beyond the end", "So far leads the motion before it, where it was cut off and does not stand still."
    )
    clipped_share: float = _set(1e-3, "share of the samples", "So few move no coefficient by its interval.")
    line_share: float = _set(
        0.1, "share of the power", "A line with less is not what the record is of, and does not ask for a faster one."
    )


@dataclass(frozen=True)
class Candidates:
    """What is watched for, and at which frequencies and thresholds."""

    strongest: int = _set(
        3, "lines or peaks", "Beyond the strongest few the next round sees them, once those are carried."
    )
    damping_ratio: float = _set(0.005, "ζ", "A start for modes of silicon where the response does not tell.")
    off_resonance: float = _set(
        1e-3, "of the drive's power", "A drive with less elsewhere tells a mode's frequency by nothing."
    )
    least_damping_ratio: float = _set(1e-4, "ζ", "A response that tells less is narrower than its own bins.")
    beside_peak: int = _set(8, "bins to either side", "So many bins of the response belong to the peak of one mode.")
    saturation: tuple[float, ...] = _set(
        (0.04, 0.12, 0.3, 0.55, 0.75, 0.92), "of the largest drive", "From one to the next, a climb reaches the limit."
    )
    dead_band: tuple[float, ...] = _set((0.02, 0.06, 0.15, 0.5), "of the drive's rms", "The same for a dead band.")
    clipping: tuple[float, ...] = _set(
        (0.6, 0.75, 0.9, 0.98), "of the largest sensed displacement", "The same for a level of the sense."
    )
    segment: int = _set(4096, "samples", "Resolves modes a thousandth of the sampling rate apart.")
    segments: int = _set(8, "segments in the record at least", "A coherence of fewer segments is one by itself.")


@dataclass(frozen=True)
class Criterion:
    """What chance gains."""

    chance: float = _set(1e-4, "probability", "Of a check to fail where all is well, or of a motion that is none.")


@dataclass(frozen=True)
class Start:
    """How a pass over a record begins."""

    cycles: float = _set(1.5, "cycles", "They show the motion to some percent, as far as amplitude and rate may move.")
    harmonics: int = _set(3, "orders", "What a channel bends is in the second and the third.")
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

    bins: int = _set(64, "bins", "Fewer tell a floor to no better than a fifth.")
    upper: float = _set(4.0, "1 / share of the sampling rate", "The floor is read from the upper half of the spectrum.")
    above: float = _set(1.5, "resonances", "And from above the resonance's own skirts.")
    periodic: float = _set(1e-4, "of the drive's rms", "A period that comes back is the same to this.")
    compared: int = _set(256, "samples", "Two periods are compared over that at least.")


@dataclass(frozen=True)
class Spectrum:
    """Lines of the residual and the floor around them."""

    orders: int = _set(5, "multiples of the resonance", "Laws of motion up to the fifth power show there.")
    sideband: float = _set(
        1.0 / 8.0, "resonances", "So near to a multiple a line is what modulation and rotation make of that."
    )
    floor_bins: int = _set(512, "bins", "The median of so many is sure to 5 %.")
    floor_width: float = _set(0.5, "resonances", "Four bands: what is in one moves the median little.")
    skirts: float = _set(6.0, "× the floor", "A line's skirts end there.")


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
