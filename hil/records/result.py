"""`result.json`: the figures of a run. Its JSON Schema is published in docs/reference/result.schema.json."""

from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from hil.numbers import percent, quantity, significant, typeset
from hil.records import json_file
from hil.records.setting import Setting

_SPACE = "\N{NO-BREAK SPACE}"


NonNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]


RunVerdict = Literal["good", "failed", "interrupted", "unsafe"]
PartOutcome = Literal["good", "complete", "lacks", "failed", "unsafe", "unknown"]


class Reason(NamedTuple):
    """Why a run is not good, one line, and what mends that: a command or an act, "" where nobody knows."""

    text: str
    cure: str = ""


def next_of(reasons: Sequence[Reason]) -> str:
    """The cure of the first reason that has one, "" where none has."""
    return next((reason.cure for reason in reasons if reason.cure), "")


class Part(json_file.Strict):
    """One part of a verdict."""

    outcome: PartOutcome = Field(description="unknown: there is nothing to judge it by")
    reason: str = Field(default="", description="Why, one line")
    next: str | None = Field(default=None, description="The command or act that comes next")

    @property
    def against(self) -> bool:
        """Whether this part speaks against the run."""
        return self.outcome in ("lacks", "failed", "unsafe")

    @property
    def beside_outcome(self) -> str:
        """The reason as it reads after the outcome, whose word it need not say again."""
        return self.reason.removeprefix(f"{self.outcome} ")

    @classmethod
    def of(cls, reasons: Sequence[Reason], *, good: PartOutcome = "good", bad: PartOutcome = "failed") -> Self:
        """`good` where there is no reason against, else `bad` with the reasons in one line, the cause first: what comes
        next is the cure of the first that has one.
        """
        told = "; ".join(reason.text for reason in reasons)
        return cls(outcome=bad if reasons else good, reason=told, next=next_of(reasons) or None)


class Percentiles(json_file.Strict):
    """Percentiles of a time, in µs."""

    p50: NonNegative
    p99: NonNegative
    p999: NonNegative

    @property
    def line(self) -> str:
        return f"{self.p50:.0f}, {self.p99:.0f}, {self.p999:.0f} µs"


class Ledger(json_file.Strict):
    """Where the time of a block of samples goes, in force mode of a single one; over those whose answer is known to
    have acted. Both ends on the host's clock."""

    wire: Percentiles = Field(
        description="From the sampling of its last row to the host; at least: beyond the fastest block, or what the "
        "board's own time and tick leave it where that is more"
    )
    estimate: Percentiles = Field(description="Until the observer was done")
    send: Percentiles = Field(description="Until the answer was sent")
    apply: Percentiles = Field(description="Until it acted, in gain mode until the first sample computed with it")
    total: Percentiles = Field(description="All of it")


class ClockRelation(json_file.Strict):
    """The board's clock beside the host's, by exchanges of time; intervals are 95 %."""

    at_host_ns: int = Field(description="Host time, monotonic, that the offset is for")
    offset_ns: int = Field(description="Board's clock less the host's at that time")
    offset_uncertainty_ns: NonNegative = Field(
        description="Half the shortest round trip, which bounds what an asymmetry of the link does, and half the "
        "interval by the scatter of the exchanges"
    )
    skew_ppm: float = Field(description="By how much the board's clock runs faster than the host's")
    skew_uncertainty_ppm: NonNegative = Field(description="Half the interval by the scatter of the exchanges")
    skew_bound_ppm: NonNegative = Field(
        description="What an asymmetry that changes in the worst possible way could move the skew by"
    )
    round_trip_us: NonNegative = Field(description="The shortest")
    exchanges: Count
    used: Count = Field(description="The quickest of each part of the run, which the relation comes from")


class SampleRate(json_file.Strict):
    """How often the board samples, by the host's clock: of a run on wall time."""

    declared_Hz: NonNegative = Field(description="By IDENTITY, and the bench file")
    measured_Hz: NonNegative
    off_ppm: float = Field(description="By how much it is more than declared")
    uncertainty_ppm: NonNegative = Field(description="Half the 95 % interval, by the scatter of the earliest arrivals")

    @property
    def line(self) -> str:
        off = typeset(f"{self.off_ppm:+.1f}")
        return f"{off} ± {self.uncertainty_ppm:.1f} ppm off the declared {self.declared_Hz:g} Hz, by the host's clock"


class BoardClock(json_file.Strict):
    """What the times of a run are on, and how that is related to the host's clock."""

    time_base: str = Field(description="Of every tick and time in the capture, in words")
    relation: ClockRelation | None = None
    sample_rate: SampleRate | None = Field(default=None, description="Null in lockstep, and of too short a run")
    unknown: str | None = Field(default=None, description="Why there is no relation, one line")

    @property
    def line(self) -> str:
        if (found := self.relation) is None:
            return f"not compared with the host's; {self.unknown}"
        skew, offset_s = typeset(f"{found.skew_ppm:+.2f}"), typeset(f"{1e-9 * found.offset_ns:.6f}")
        return (
            f"{skew} ± {found.skew_uncertainty_ppm:.2f} ppm relative to the host's, offset "
            f"{offset_s} s ± {1e-3 * found.offset_uncertainty_ns:.1f} µs "
            f"({found.exchanges} exchanges, the shortest {found.round_trip_us:.1f} µs)"
        )


class Load(json_file.Strict):
    """Time on a processor over time, 1 being all of one core."""

    loop: NonNegative = Field(description="Of the thread that answers the board, while it was driven")
    recorder: NonNegative = Field(
        default=0.0,
        description="Of the process that writes the records, in the same time; 0 where the loop itself does",
    )
    waited: NonNegative | None = Field(
        default=None, description="Of the thread that answers: ready to run, and no processor free for it"
    )
    stolen: NonNegative | None = Field(
        default=None, description="Of a processor of this machine, on average: used by the hypervisor"
    )
    pressed: NonNegative | None = Field(
        default=None, description="Share of the time in which something on this machine waited for a processor"
    )

    @property
    def lacked(self) -> float | None:
        """Share of the time in which the process that answers could not run though it was ready."""
        return None if self.waited is None else self.waited + (self.stolen or 0.0)


class Told(json_file.Strict):
    """A figure that an algorithm tells of itself."""

    name: str
    value: float | None = Field(description="Null where it is not finite")
    unit: str
    limit: float | None = Field(default=None, description="That it had to keep; null without one")


class Answers(json_file.Strict):
    """What became of each sample, first to last tick of the record; the parts add up to `ticks`."""

    ticks: Count = Field(description="Samples the board took, from the first recorded to the last")
    in_time: Count = Field(description="Answered, and neither the record nor the board says that it was not in time")
    late: Count = Field(description="Answered; the answer reached the board after its effective tick")
    unanswered: Count = Field(description="Seen by the host when newer ones had come, of which the newest was answered")
    lost_to_board: Count = Field(description="Answered; the answer did not reach the board, or found it SAFE")
    lost_to_host: Count = Field(description="Not in the record, while the board streamed")
    stopped: Count = Field(description="Not in the record: the board was SAFE until it was armed again")
    slow: Count = Field(description="No part of the sum: answers that left the host after its deadline, of all answers")

    @property
    def missed(self) -> int:
        """Samples seen by the host that had no answer in time."""
        return self.late + self.unanswered + self.lost_to_board

    @property
    def parts(self) -> dict[str, int]:
        return {
            "answered in time": self.in_time,
            "answered late": self.late,
            "not answered": self.unanswered,
            "lost on the way to the board": self.lost_to_board,
            "lost on the way to the host": self.lost_to_host,
            "while the board was SAFE": self.stopped,
        }

    @model_validator(mode="after")
    def _adds_up(self) -> Self:
        if sum(self.parts.values()) != self.ticks:
            raise ValueError(f"the parts are {sum(self.parts.values())} samples, ticks is {self.ticks}")
        return self


class Holds(json_file.Strict):
    """The quickest setting of a board at which this machine, as it was in the run, answers it in time on that link."""

    latency_ticks: Count = Field(description="Force mode: from a sample to the interval its answer acts on; else 0")
    block: Count = Field(description="Gain mode: samples of a SENSE; 1 else")
    rate_Hz: NonNegative = Field(description="Samples a second")
    expected: Fraction = Field(description="Late answers of a run of that length, by how late those of the record were")
    at_most: Fraction = Field(description="Upper end of the one-sided 95 % prediction interval of that")
    safely: bool = Field(description="Whether it leaves a margin to [limits] late_fraction: a third of it is expected")

    @property
    def setting(self) -> Setting:
        return Setting(self.latency_ticks, self.block, self.rate_Hz)

    @property
    def line(self) -> str:
        late = f"{percent(self.expected, 2)} of the answers expected late"
        return f"{self.setting.words}: {late}, at most {percent(self.at_most, 2)} (95{_SPACE}%)"


class Constant(json_file.Strict):
    """A constant at the end of the run, estimated or as declared."""

    value: float
    ci95: tuple[float, float] | None = Field(
        description="95 % interval, [low, high]; null: not given, as of a constant that is not estimated"
    )
    unit: str
    truth: float | None = None
    declared: bool = Field(default=False, description="The bench file's value: nothing estimated it")

    @property
    def half(self) -> float | None:
        return None if self.ci95 is None else 0.5 * (self.ci95[1] - self.ci95[0])


class Parameter(Constant):
    """An estimated constant, with its interval."""

    ci95: tuple[float, float] = Field(description="95 % interval, [low, high]")


class Nees(json_file.Strict):
    """Normalised estimation error squared, eᵀ C⁻¹ e, over the entries that have a truth, per entry: 1 for an observer
    that knows how wrong it is, more for one that thinks too well of itself."""

    mean: NonNegative = Field(description="Over the scored instants that have a covariance")
    entries: Count = Field(description="Estimated entries with a truth")
    instants: Count
    independent: NonNegative = Field(
        description="How many independent instants these are worth at least: the window in memories of the observer, 1 "
        "for a plain EKF"
    )
    band: tuple[float, float] = Field(
        description="Interval that holds the mean in 95 % of runs if the covariance is right (χ² of so many instants)"
    )


class Score(json_file.Strict):
    """Estimates beside the truth, over the scored window."""

    window_s: tuple[float, float] = Field(description="First and last scored instant, bench time")
    rows: Count = Field(description="Instants compared")
    turns: NonNegative = Field(description="True rotation over the window, back and forth added up, in rotations")
    angle_per_rotation: float | None = Field(
        default=None, description="Slope of the reported angle over the true angle; null below half a radian"
    )
    angle_error_max_rad: NonNegative | None = None
    angle_error_end_rad: NonNegative | None = Field(
        default=None,
        description="At the last scored instant, beside `angle_expanded_rad`; null where a truth ends early",
    )
    rate_error_max_rad_s: NonNegative | None = None
    pattern_angle_error_rms_rad: NonNegative | None = Field(
        default=None,
        description="Estimated pattern angle, less the virtual rotation only, minus the true rotation",
    )
    angle_estimation_error_rms_rad: NonNegative | None = Field(
        default=None, description="Of it, pattern angle of the estimated state minus that of the true state"
    )
    control_imperfection_rms_rad: NonNegative | None = Field(
        default=None, description="The rest: the true pattern does not turn exactly with the rotation"
    )
    coverage: dict[str, Fraction] = Field(
        default_factory=dict,
        description="Per state, the fraction of instants whose 95 % interval holds the truth",
    )
    nees: Nees | None = Field(default=None, description="Null for a run folder without covariance.arrow")


class Contribution(json_file.Strict):
    """One row of the angle's uncertainty budget (JCGM 100): a source, how well it is known, what it does."""

    source: str
    value: NonNegative = Field(description="Standard uncertainty of the source, in `unit`")
    unit: str
    sensitivity: str = Field(description="How it reaches the angle, in words and figures")
    contribution_rad: NonNegative = Field(
        description="Standard uncertainty of the angle by this source, at the end of the scored window"
    )
    declared_rad: NonNegative | None = Field(
        default=None,
        description="The same as declared, which the estimates have; null for what only the closing scan tells",
    )
    assumed: bool = Field(default=False, description="The bench file declares nothing: a usual value was taken")
    found: bool = Field(default=False, description="The scan found that it is wrong: this is the effect of that error")


class Lacking(json_file.Strict):
    """An effect that the record shows and the model lacks."""

    effect: str
    coefficients: dict[str, Parameter]
    angle_rad: NonNegative = Field(
        description="How far the reported angle is off without it, where that is most over the scored window"
    )
    angle_ci95: tuple[float, float] = Field(description="95 % interval, [low, high]")
    alike: tuple[str, ...] = Field(default=(), description="Effects that this record cannot tell from it")


class Unexcluded(json_file.Strict):
    """What the record leaves open of one coefficient, were its effect there and no other."""

    effect: str
    symbol: str
    unit: str
    deviation: NonNegative = Field(description="Standard deviation, in `unit`; at most the plausible size")
    angle_rad_per_unit: float = Field(
        description="By how much a unit of it moves the reported angle by the end of the scored window"
    )
    angle_rad: NonNegative = Field(description="Angle error by its whole effect, rms, where that is largest")


class Scan(json_file.Strict):
    """The scan that closes a run: the model held against its record."""

    complete: bool | None = Field(description="Null: the record could not be scanned")
    reason: str = Field(description="Why, one line")
    lacks: tuple[Lacking, ...] = ()
    harmless: tuple[Lacking, ...] = Field(
        default=(), description="Lacking too, but it moves the angle by far less than [limits] angle_rad"
    )
    cannot_exclude: tuple[Unexcluded, ...] = Field(
        default=(), description="Every tested coefficient, the one with the largest possible angle error first"
    )
    ratio: NonNegative | None = Field(default=None, description="Innovation over what was predicted of it, rms")
    samples: Count = Field(description="Looked at")
    span_s: NonNegative = Field(description="Of the record, that hold them")
    seconds: NonNegative = Field(description="That the scan took")


class Angle(json_file.Strict):
    """The reported angle at the end of the scored window, zero at its start, and what the source of the method has."""

    kind: Literal["pattern", "rate"] = Field(
        description="pattern: formula (11) on the vibration, less what forces turned it by; rate: the integrated rate"
    )
    why: str = Field(default="", description="Which formula gives the angle, and why, one line")
    rad: float
    plain_rad: float | None = Field(
        default=None, description="Formula (11) of the source, less the virtual rotation alone"
    )
    control_imperfection_rms_rad: NonNegative | None = Field(
        default=None,
        description="Pattern less the virtual rotation alone, minus the reported angle, over the scored window: "
        "0 with an ideal control",
    )


class Channel(json_file.Strict):
    """One axis of a rate-output sensor over a record."""

    mean_rad_s: float
    sd_rad_s: NonNegative = Field(description="Spread of all samples, motion included")
    noise_rad_s: NonNegative | None = Field(
        default=None, description="White noise of a sample, from the differences of neighbours"
    )


class Sensor(json_file.Strict):
    """A rate-output sensor as recorded."""

    device: str
    sample_rate_Hz: NonNegative = Field(description="By the sensor's clock, which is the record's")
    host_rate_Hz: NonNegative | None = Field(default=None, description="The same by this machine's clock")
    channels: dict[str, Channel] = Field(default_factory=dict)
    status: dict[str, Count] = Field(default_factory=dict, description="Samples with each complaint of the sensor")
    latency_us: Percentiles | None = Field(
        default=None, description="From the sample to its first byte, as the sensor says"
    )


TOO_SLOW = "this machine answered too late: the loop was open at times, so the angle errors do not compare the models"
"""Of two runs, where one of them is not `Result.kept_up`."""


class OwnReading(json_file.Strict):
    """What the bench's own observer reads of the record of a plug-in, where in the scored window their angles are
    farthest apart, both zero at its start."""

    plugin_rad: float
    own_rad: float
    own_expanded_rad: NonNegative = Field(description="That the bench's observer is uncertain by, by itself (k = 2)")


class OnBoard(json_file.Strict):
    """What the board's own estimator said, beside the host's estimates of the same samples, where the board calls its
    angle valid; once scored, the truth."""

    rows: Count = Field(description="Estimates recorded")
    valid_fraction: NonNegative | None = Field(
        default=None, description="Share of the scored window at which the board calls its angle valid"
    )
    angle_difference_rms_rad: NonNegative | None = Field(
        default=None, description="Board's angle less the host's, zero at the start of the scored window"
    )
    angle_difference_end_rad: NonNegative | None = None
    rate_difference_rms_rad_s: NonNegative | None = None
    angle_error_rms_rad: NonNegative | None = Field(default=None, description="Board's angle less the true rotation")
    rate_error_rms_rad_s: NonNegative | None = None
    score: Score | None = None

    @property
    def line(self) -> str:
        told = [
            f"{name} {quantity(size, unit)}{when}"
            for name, size, unit, when in (
                ("angle", self.angle_difference_end_rad, "rad", " at the end"),
                ("before it", self.angle_difference_rms_rad, "rad", " rms"),
                ("rate", self.rate_difference_rms_rad_s, "rad/s", " rms"),
            )
            if size is not None
        ]
        return ", ".join(told) or "not compared: the board called no angle valid that the host has too"


class Reference(json_file.Strict):
    """A commercial gyro that was recorded beside the run, and the device beside it: rate = bias + (1 + scale) times the
    reference's rate of `delay` ago."""

    link: str
    axis: str
    sign: Literal[-1, 1]
    samples: Count = 0
    lost: Count = Field(default=0, description="Missing in the reference's own count")
    silent_s: NonNegative = Field(default=0.0, description="The longest time in which nothing came")
    stopped: str = Field(default="", description="Why it ended before the run did")
    counters: dict[str, int] = Field(default_factory=dict)
    sensor: Sensor | None = None
    time_u_ms: NonNegative | None = Field(
        default=None, description="Standard uncertainty of its time on the bench's: both clocks, its line, its stamps"
    )
    skew_ppm: float | None = Field(default=None, description="Its clock beside this machine's")
    scale_error: Parameter | None = Field(default=None, description="Null where the reference does not turn enough")
    bias: Parameter | None = None
    delay: Parameter | None = Field(
        default=None, description="Of the device behind the reference, with time_u_ms in it"
    )
    rate_rms_rad_s: NonNegative | None = Field(default=None, description="What the fit leaves of the rate")
    angle_rms_rad: NonNegative | None = Field(
        default=None, description="Angle minus the reference's integral, zero where the scored window begins"
    )
    unknown: str = Field(default="", description="Why it is not compared")

    @property
    def line(self) -> str:
        if self.bias is None:
            return f"not compared: {self.unknown}"
        told = [
            f"{name} {significant(one.value, 4)} ({' to '.join(significant(end, 4) for end in one.ci95)}) "
            f"{one.unit}".rstrip()
            for name, one in (("scale error", self.scale_error), ("bias", self.bias), ("delay", self.delay))
            if one is not None
        ]
        return f"{', '.join(told)}; time ± {self.time_u_ms:.3g} ms"


class Result(json_file.Sealed):
    """Figures of one run. Null: not measured, or no reference to measure against."""

    version: Literal[2] = 2
    run: str = Field(description="Name of the run folder")
    link: str | None = None
    clock: Literal["lockstep", "paced", "real"] | None = Field(default=None, description="Null for a replay")
    mode: Literal["force", "gain", "board"] | None = Field(default=None, description="Null for a replay")
    seconds: NonNegative = Field(description="Length of the record in bench time")
    samples: Count
    lost: Count = Field(default=0, description="Samples missing between the first and the last")
    late: Count = Field(default=0, description="Samples whose answer reached the board after its effective tick")
    answers: Answers | None = Field(default=None, description="Null where no board was answered")
    angle_error_rms_rad: NonNegative | None = Field(
        default=None,
        description="Reported angle minus true rotation, zero at the start of the scored window: by the truth of an "
        "emulated board, or by the integral of the record's own rate_rad_s",
    )
    rate_error_rms_rad_s: NonNegative | None = None
    angle: Angle | None = Field(default=None, description="Null where no angle is reported")
    angle_u_rad: NonNegative | None = Field(
        default=None,
        description="Standard uncertainty (k = 1) of the reported angle at the end of the scored window, the angle "
        "being zero at its start; null where no angle is reported",
    )
    angle_expanded_rad: NonNegative | None = Field(
        default=None, description="Expanded uncertainty U (k = 2) of the same: twice angle_u_rad"
    )
    uncertainty: tuple[Contribution, ...] = Field(
        default=(), description="Its budget: angle_u_rad is the root of the sum of the squared contributions"
    )
    parameters: dict[str, Constant] = Field(default_factory=dict)
    sense_unit: str = Field(default="V", description="Unit of what is sensed: V, or the sensor's own, as LSB")
    innovation_rms: NonNegative | None = Field(
        default=None, description="In sense_unit, over the scored window and all axes"
    )
    noise_floor: NonNegative | None = Field(
        default=None,
        description="V, the innovation's rms as the observer predicts it, the model being complete",
    )
    turnaround_us: Percentiles | None = None
    ledger_us: Ledger | None = Field(default=None, description="The stages of a block, on wall time")
    board_clock: BoardClock | None = Field(default=None, description="Null for a replay")
    load: Load | None = Field(default=None, description="What the host needed of a core, from ARM to SAFE")
    algorithm: tuple[Told, ...] = Field(
        default=(),
        description="What a plug-in, the loops of [controller] mode, or trim electrodes tell, in their order",
    )
    bare_turnaround_us: Percentiles | None = Field(
        default=None, description="A bare read and write, paced alike in the same run"
    )
    holds: Holds | None = Field(
        default=None, description="Null in lockstep, and where no setting of the board would be answered in time"
    )
    scan: Scan | None = Field(default=None, description="Null where nothing was recorded that could be scanned")
    diagnosis: dict[str, Any] | None = None
    verdict: RunVerdict | None = None
    parts: dict[Literal["safety", "machine", "model", "angle"], Part] = Field(
        default_factory=dict, description="The verdict of a run in its parts, worst first"
    )
    reasons: tuple[str, ...] = Field(default=(), description="One line per limit that was not kept")
    next: str | None = Field(default=None, description="The command or act that comes next")
    score: Score | None = None
    board: OnBoard | None = Field(
        default=None, description="The board's own estimates, of a run in board mode; null where it said none"
    )
    own_reading: OwnReading | None = Field(
        default=None, description="Of a run with an observer plug-in; null where the bench's own observer has no angle"
    )
    sensor: Sensor | None = Field(default=None, description="A sensor that was recorded, not driven")
    reference: Reference | None = Field(default=None, description="Null without a reference beside the run")
    counters: dict[str, int] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)
    serial_number: str | None = None
    operator_note: str | None = None
    remarks: tuple[str, ...] = Field(
        default=(), description="What the system refused the loop and what went wrong on the way, one line each"
    )
    complete: bool = Field(description="False when the capture lacks its end marker")

    @property
    def alarm(self) -> str:
        """What an unsafe run says before anything else."""
        safety = self.parts.get("safety")
        return (safety and safety.reason) or "a stop was not confirmed: cut the supply"

    @property
    def against(self) -> dict[str, str]:
        """Why each part that speaks against the run does, by its name."""
        return {name: part.reason for name, part in self.parts.items() if part.against}

    @property
    def residual_ratio(self) -> float | None:
        """The innovation over its noise floor, rms; None where one is not known."""
        return self.innovation_rms / self.noise_floor if self.innovation_rms is not None and self.noise_floor else None

    @property
    def kept_up(self) -> bool:
        """Whether this machine was fast enough for its part, as far as that is known."""
        return "machine" not in self.parts or not self.parts["machine"].against


save_result = json_file.save
load_result = partial(
    json_file.load, model=Result, give="the folder of a run", anew="replay the capture to write it anew"
)
