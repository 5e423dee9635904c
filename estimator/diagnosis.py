"""What tracing answers."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from estimator.scaling import Array


class Verdict(Enum):
    """What the record says of the model."""

    ADEQUATE = "adequate"
    EXPLAINED = "explained"
    PARTLY = "partly explained"
    UNEXPLAINED = "unexplained"

    @property
    def is_open(self) -> bool:
        """Whether something is left that is not accounted for."""
        return self in (Verdict.PARTLY, Verdict.UNEXPLAINED)


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval, SI; `unit` as the report prints it."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Found:
    """An effect that the model lacks; `evidence` is twice the gain of log-likelihood on the fitting part, `angle_bound`
    by how much in rad the angle may be wrong because the coefficients are known within their intervals only.
    """

    name: str
    title: str
    equation: tuple[str, ...]
    coefficients: Mapping[str, Interval]
    evidence: float
    compensation: str
    angle_bound: float | None = None


@dataclass(frozen=True)
class Separation:
    """Two members of an ambiguity group, how alike they are, and the experiment that would separate them.

    `correlation` of their signatures with everything else that is estimated projected out; `separate_by` an experiment
    in words, None where nothing separates them; `experiment` its name where a run can make it; `expected` their
    correlation in that experiment; `angle_apart` how far in rad the angle moves with the other in the model instead;
    `takes` how long in s a run has to last that separates them 95 times in 100.
    """

    effect: str
    other: str
    correlation: float
    separate_by: str | None
    expected: float | None
    angle_apart: float | None = None
    experiment: str | None = None
    takes: float | None = None


@dataclass(frozen=True)
class Rejected:
    """A candidate that was not taken, and why.

    bound: an upper bound (95 %) on each coefficient, SI, where there is one; evidence: as of `Found`, what a scan of
    the first residual promised of it by itself, where that was computed; gain: as of `Found`, what it gained where it
    was last carried, None where it never was.
    """

    name: str
    reason: str
    bound: Mapping[str, Interval] = field(default_factory=dict)
    evidence: float | None = None
    gain: float | None = None


@dataclass(frozen=True)
class Finding:
    """Something seen in the residual: where it is, and its size beside that by chance.

    kind: "line", "whiteness", "level"; `size` in volts of that part of the residual, rms over the axes; `significance`
    in standard deviations.
    """

    kind: str
    text: str
    size: float
    significance: float


@dataclass(frozen=True)
class Fit:
    """How well a model predicts a part of the record.

    `innovation_rms` and `noise_floor` in volts per channel; `ratio` of the two (1 when nothing is missing);
    `whiteness_p` of Ljung and Box; `simulation_rmse` of a free run in volts, `angle_error_rms` [rad] and
    `rate_error_rms` [rad/s] where a reference exists; `floor_from`: how the noise floor was found, in words.
    """

    innovation_rms: tuple[float, ...]
    noise_floor: tuple[float, ...]
    ratio: float
    whiteness_p: float
    simulation_rmse: float | None = None
    angle_error_rms: float | None = None
    rate_error_rms: float | None = None
    floor_from: str = "the declared noise"


@dataclass(frozen=True)
class Classes:
    """How probable each account of a record is, the largest first; their sum is 1.

    effect: which of the effects named it is about, None where none is; probabilities: by kind of effect, of "nothing",
    and of "something else" than the catalogue has, alone or besides.
    """

    effect: str | None
    probabilities: Mapping[str, float]


@dataclass(frozen=True)
class Dependence:
    """A constant of the model, or a coefficient, that goes with a covariate of the records: `value` where that is at
    `reference`, `slope` for one of the covariate; `evidence` as of `Found`.
    """

    name: str
    covariate: str
    reference: float
    value: Interval
    slope: Interval
    evidence: float


@dataclass(frozen=True)
class Unconfirmed:
    """The best model of a search that a check rejects: its effects, sentences of the checks that failed, and what it
    leaves on the part held out.
    """

    effects: tuple[Found, ...]
    failed: tuple[str, ...]
    held_out: Fit


@dataclass(frozen=True)
class Diagnosis:
    """The answer of a trace; `before` and `after` are of the part that was fitted, `held_out_*` of the rest.

    reasons: why the verdict is what it is; angle_moved: largest change of the reported angle, rad, when all that brings
    the residual down is carried, None where nothing does; share: of the residual's power above the noise floor, on the
    part held out, what the effects account for, None where none are named; left: what the residual still holds with the
    effects, where something is left; probabilities: one for each effect that is named, one where none is, none where
    nobody was carried; undetermined: sentences on constants that the record does not determine; dependences: of several
    records, what goes with their covariate; free_run: of what was traced by the free run, measured less simulated volts
    (m, axes) from the split on, as far as is shown, before and after, NaN where that set its state; base: of a rate
    sensor, the line V0 + S Ω as fitted; unconfirmed: where nothing is named, the best candidate all the same, None
    where there is none.
    """

    verdict: Verdict
    effects: tuple[Found, ...]
    separations: tuple[Separation, ...]
    rejected: tuple[Rejected, ...]
    findings: tuple[Finding, ...]
    before: Fit
    after: Fit
    held_out_before: Fit
    held_out_after: Fit
    residual_before: Array
    residual_after: Array
    split: int
    reasons: tuple[str, ...]
    angle_moved: float | None = None
    share: float | None = None
    left: tuple[Finding, ...] = ()
    probabilities: tuple[Classes, ...] = ()
    undetermined: tuple[str, ...] = ()
    dependences: tuple[Dependence, ...] = ()
    free_run: tuple[Array, Array] | None = None
    base: Mapping[str, Interval] = field(default_factory=dict)
    unconfirmed: Unconfirmed | None = None

    @property
    def ambiguity_groups(self) -> tuple[tuple[str, ...], ...]:
        """For each effect with members beside it: the members that this record cannot tell apart, the named first."""
        members: dict[str, list[str]] = {}
        for pair in self.separations:
            members.setdefault(pair.effect, [pair.effect]).append(pair.other)
        return tuple(map(tuple, members.values()))

    def of_what_is_named(self) -> "Diagnosis":
        """The same; where nothing is named, the figures after are those before: no others stand beside a model."""
        if self.effects or self.dependences:
            return self
        return replace(
            self,
            after=self.before,
            held_out_after=self.held_out_before,
            residual_after=self.residual_before,
        )
