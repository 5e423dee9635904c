"""`diagnosis.json`: what a trace came to. Its JSON Schema is published in docs/reference/diagnosis.schema.json."""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from estimator import diagnosis as traced
from estimator.thresholds import THRESHOLDS, values
from hil.numbers import finite
from hil.records import json_file

NonNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0)]


class Coefficient(json_file.Strict):
    """An estimate, SI per unit mass."""

    value: float | None
    ci95: tuple[float | None, float | None] = Field(description="95 % interval, [low, high]; null where unbounded")
    unit: str

    @property
    def may_be_zero(self) -> bool:
        low, high = self.ci95
        return (low is None or low <= 0.0) and (high is None or high >= 0.0)


class Effect(json_file.Strict):
    """A physical effect that the model lacks."""

    name: str = Field(description="As in [effects.NAME] of a bench file")
    title: str
    equations: tuple[str, ...]
    coefficients: dict[str, Coefficient]
    evidence: float | None = Field(description="Twice the gain of log-likelihood on the fitting part")
    compensation: str = Field(description="How the loop and the angle are corrected for it once it is declared")
    angle_bound_rad: float | None = Field(
        default=None, description="Largest angle error that compensation leaves, by the 95 % intervals"
    )

    @model_validator(mode="before")
    @classmethod
    def _of_the_version_before(cls, given: object) -> object:
        """`undone`, as `compensation` was called, is read for one version."""
        if isinstance(given, dict) and "undone" in given:
            return {("compensation" if key == "undone" else key): value for key, value in given.items()}
        return given


class Dependence(json_file.Strict):
    """A constant of the model, or a coefficient, that goes with a covariate of the records traced together."""

    name: str
    covariate: str
    reference: float = Field(description="Of the covariate: there the constant is `at_reference`")
    at_reference: Coefficient
    per_unit: Coefficient = Field(description="Change per unit of the covariate")
    evidence: float | None = Field(description="As in effects")


class Separation(json_file.Strict):
    """Two members of an ambiguity group, and what would separate them."""

    effect: str
    with_: str = Field(alias="with")
    correlation: float | None = Field(description="Of their signatures, all that is estimated projected out")
    separate_by: str | None = Field(description="The experiment that would separate them; null where none would")
    experiment: str | None = Field(default=None, description="Its name, where `hil trace --live` can make it")
    expected: float | None = Field(description="Their correlation in that experiment")
    takes_s: NonNegative | None = Field(
        default=None, description="How long it has to last to separate them 95 times in 100"
    )
    angle_apart_rad: float | None = Field(
        default=None, description="Largest change of the angle with the other instead"
    )


class Rejected(json_file.Strict):
    """A candidate that was not taken."""

    name: str
    reason: str
    bound: dict[str, Coefficient] = Field(
        default_factory=dict, description="Largest coefficients that the record allows, where it determines them"
    )
    evidence: float | None = Field(
        default=None,
        description="What the score test of the first residual predicts for it alone, in the units of effects",
    )
    gain: float | None = Field(
        default=None, description="Its gain where it was last fitted, as in effects; null where it never was"
    )


class Finding(json_file.Strict):
    """Something seen in the residual of the model as it was."""

    kind: str
    text: str
    size_V: float | None = Field(description="rms of that part of the residual, in sense_unit")
    significance: float | None = Field(description="In standard deviations, corrected for the number of places tested")
    points_at: tuple[str, ...] = Field(default=(), exclude=True, description="Of older files; not written any more")


class Channel(json_file.Strict):
    """The same of one sense axis."""

    innovation_rms: float | None
    noise_floor: float | None


class Fit(json_file.Strict):
    """How well a model predicts a part of the record. Null: not finite, or no reference to measure against."""

    innovation_rms: float | None = Field(description="In sense_unit, over all axes")
    noise_floor: float | None = Field(description="In sense_unit, over all axes: what a complete model would leave")
    ratio: float | None = Field(description="The one over the other, the mean of the axes' squares")
    whiteness_p: float | None = Field(description="Ljung and Box")
    simulation_rmse: float | None = Field(
        description=(
            "In sense_unit, of free runs that see the drive only: over the whole part, for a gyro over 20 cycles each"
        )
    )
    angle_error_rms_rad: float | None = None
    rate_error_rms_rad_s: float | None = None
    axes: tuple[Channel, ...] = ()
    floor_from: str = Field(default="", description="How the noise floor was found")


class Probabilities(json_file.Strict):
    """How probable each account of the record is; the sum is 1."""

    effect: str | None = Field(description="Which of `effects` it is about; null where none is named")
    classes: dict[str, Annotated[float, Field(ge=0, le=1)]] = Field(
        description="By kind of effect, `nothing`, and `something else` than the catalogue has, alone or besides"
    )


class FormTerm(json_file.Strict):
    """A term of the form of a missing force: c times the form, on each axis with a coefficient of its own or on both
    with one.
    """

    form: str = Field(
        description="In q, v, u: an axis' displacement, velocity, drive; p, w, s: those of the other axis; r, v of the "
        "plane where the coefficient is of both; J turns by a right angle; or an effect of the catalogue in words"
    )
    sensed: bool = Field(description="Whether it is added to the sensed displacement; it is not a force then")
    coefficients: dict[str, Coefficient] = Field(
        description="By axis, x, y or both; of a wave by cos and sin as well; of an effect by symbol"
    )
    inside: dict[str, Coefficient] = Field(
        default_factory=dict, description="Numbers inside the form, found with it: a gap, a limit, a frequency"
    )
    laws: dict[str, tuple[str, str]] = Field(
        default_factory=dict,
        description="By coefficient, what one of it adds along x and y, in the grammar of [effects.custom]; none for "
        "an effect of the catalogue",
    )
    effect: str = Field(default="", description="Name of the effect of the catalogue that has this form, or empty")

    @property
    def declarable(self) -> bool:
        """Whether a bench file can declare it, and it is more than nothing."""
        return bool(self.laws or self.effect) and not all(one.may_be_zero for one in self.coefficients.values())


class MissingForce(json_file.Strict):
    """The force per mass that the model lacks, without a name; its form is no cause. The force itself: force.arrow."""

    form: tuple[FormTerm, ...] = Field(description="Empty: no form was better by BIC and on the part held out")
    text: str = Field(description="The same in words")
    rms_mps2: float | None = Field(description="Of the force, without the part that constants can explain")
    deviation_mps2: float | None = Field(description="Standard deviation of the force at a sample")
    left: float | None = Field(description="Share of the force, rms, that the form leaves on the part held out")
    innovation_before: float | None = Field(description="Held out, over what is expected of noise")
    innovation_after: float | None = Field(description="The same with the form")
    first: Count = Field(default=0, description="First sample that was looked at")
    samples: Count = Field(default=0, description="How many were, one after another")
    refused: str | None = Field(default=None, description="Why there is none")


class Unconfirmed(json_file.Strict):
    """The best candidate of the search, which a check rejects: no answer, and no bench file gets it."""

    effects: tuple[Effect, ...]
    failed: tuple[str, ...] = Field(description="The checks that failed, a sentence each")
    held_out: Fit = Field(description="What it leaves on the part held out")


class HeldOut(json_file.Strict):
    """On the part of the record that the choice never saw."""

    before: Fit
    after: Fit


class Diagnosis(json_file.Sealed):
    """The answer of a trace: before and after are of the part of the record that was fitted."""

    version: Literal[1] = 1

    @model_validator(mode="before")
    @classmethod
    def _of_the_version_before(cls, given: object) -> object:
        """`confusable`, which stood in place of groups and separations, is read for one version."""
        if not isinstance(given, dict) or "confusable" not in given:
            return given
        alike = [pair for pair in given["confusable"] if not pair.get("behind")]
        pairs = [{key: value for key, value in pair.items() if key != "behind"} for pair in alike]
        members: dict[str, list[str]] = {}
        for pair in pairs:
            members.setdefault(pair["effect"], [pair["effect"]]).append(pair["with"])
        rest = {key: value for key, value in given.items() if key != "confusable"}
        return {**rest, "separations": pairs, "ambiguity_groups": list(members.values())}

    verdict: Literal["adequate", "explained", "partly explained", "unexplained"]
    effects: tuple[Effect, ...]
    ambiguity_groups: tuple[tuple[str, ...], ...] = Field(
        default=(), description="Effects that this record cannot tell apart, the named one first"
    )
    separations: tuple[Separation, ...] = Field(
        default=(), description="Of each group, the named effect with every other member"
    )
    before: Fit
    after: Fit
    held_out: HeldOut
    rejected: tuple[Rejected, ...]
    findings: tuple[Finding, ...] = Field(description="Largest first")
    reasons: tuple[str, ...] = Field(description="Why the verdict is what it is, a sentence each")
    fault: bool = Field(
        default=False,
        description="Whether the first reason is a fault of wires or units, which is mended and not declared",
    )
    share: float | None = Field(
        default=None,
        description="Of the residual's power above the noise floor on the part held out, what the effects account for",
    )
    left: tuple[Finding, ...] = Field(
        default=(), description="What the residual still holds with the effects, largest first, where some is left"
    )
    probabilities: tuple[Probabilities, ...] = Field(
        default=(), description="How probable each account is, one for each effect that is named; one where none is"
    )
    undetermined: tuple[str, ...] = Field(
        default=(), description="Constants of which the record says less than the bench file, and what it says of them"
    )
    dependences: tuple[Dependence, ...] = Field(
        default=(), description="Of several records traced together: what goes with their covariate"
    )
    missing_force: MissingForce | None = Field(
        default=None, description="What the model lacks, as a force without a name, where something is left"
    )
    base: dict[str, Coefficient] = Field(
        default_factory=dict, description="Of a rate sensor: the line V0 + S Ω as fitted beside its effects"
    )
    unconfirmed: Unconfirmed | None = Field(
        default=None, description="Where nothing is named: the best candidate, with the checks that failed"
    )
    equations: tuple[str, ...] = Field(description="All that is added to the base model")
    angle_moved_rad: float | None = Field(
        default=None,
        description="Largest change of the reported angle over the scored window when the model includes all that "
        "reduces the residual",
    )
    sense_unit: str = Field(default="V", description="Unit of what is sensed: V, or the sensor's own, as px or µstrain")
    prepared: tuple[str, ...] = Field(
        default=(),
        description="What was done to the record as it was imported: a base taken as drive, a filter; that it was cut",
    )
    record: str = Field(description="Name of the record")
    bench: str = Field(description="[device] name of the bench file")
    samples: Count
    split: Count = Field(description="Samples that were fitted; the rest was held out")
    thresholds: dict[str, dict[str, int | float | tuple[float, ...]]] = Field(
        default_factory=dict, description="The thresholds of tracing, by group, as in estimator/thresholds.py"
    )


def to_model(
    found: traced.Diagnosis,
    *,
    record: str,
    bench: str,
    sense_unit: str = "V",
    prepared: tuple[str, ...] = (),
    missing_force: MissingForce | None = None,
    fault: bool = False,
) -> Diagnosis:
    """The engine's answer as it is written."""
    told = _fields(found, Diagnosis, {"angle_moved_rad": "angle_moved"})
    return Diagnosis.model_validate(
        told
        | {
            "held_out": HeldOut(before=_fit(found.held_out_before), after=_fit(found.held_out_after)),
            "equations": tuple(equation for effect in found.effects for equation in effect.equation),
            "sense_unit": sense_unit,
            "prepared": prepared,
            "missing_force": missing_force,
            "fault": fault,
            "record": record,
            "bench": bench,
            "samples": len(found.residual_before),
            "thresholds": values(THRESHOLDS),
        }
    )


save_diagnosis = json_file.save
load_diagnosis = partial(
    json_file.load, model=Diagnosis, give="a diagnosis that hil trace wrote", anew="trace the record anew"
)


_WRITTEN: dict[type, tuple[type[json_file.Strict], dict[str, str]]] = {
    traced.Found: (Effect, {"equations": "equation", "angle_bound_rad": "angle_bound"}),
    traced.Separation: (Separation, {"with": "other", "takes_s": "takes", "angle_apart_rad": "angle_apart"}),
    traced.Rejected: (Rejected, {}),
    traced.Finding: (Finding, {"size_V": "size"}),
    traced.Classes: (Probabilities, {"classes": "probabilities"}),
    traced.Dependence: (Dependence, {"at_reference": "value", "per_unit": "slope"}),
    traced.Unconfirmed: (Unconfirmed, {}),
}
"""What the engine answers in, and as what it is written; keys that are called otherwise there."""


def _fields(found: Any, model: type[json_file.Strict], renamed: Mapping[str, str]) -> dict[str, Any]:
    """Those of the keys of `model` that `found` has."""
    keys = {key: renamed.get(key, key) for key in (field.alias or name for name, field in model.model_fields.items())}
    return {key: _written(getattr(found, name)) for key, name in keys.items() if hasattr(found, name)}


def _written(value: Any) -> Any:
    """A part of the engine's answer; of a number that is not finite None."""
    if isinstance(value, float):
        return finite(value)
    if isinstance(value, traced.Verdict):
        return value.value
    if isinstance(value, traced.Interval):
        return coefficient(value)
    if isinstance(value, traced.Fit):
        return _fit(value)
    if isinstance(value, Mapping):
        return {key: _written(part) for key, part in value.items()}
    if isinstance(value, tuple):
        return tuple(map(_written, value))
    if (kind := _WRITTEN.get(type(value))) is None:
        return value
    return kind[0].model_validate(_fields(value, *kind))


def coefficient(interval: traced.Interval) -> Coefficient:
    # What is below the rounding of its interval is nothing.
    width = interval.high - interval.low
    nothing = np.isfinite(width) and abs(interval.value) < np.finfo(float).eps * width
    return Coefficient(
        value=0.0 if nothing else finite(interval.value),
        ci95=(finite(interval.low), finite(interval.high)),
        unit=interval.unit,
    )


def _fit(fit: traced.Fit) -> Fit:
    return Fit(
        innovation_rms=finite(float(np.sqrt(np.mean(np.square(fit.innovation_rms))))),
        noise_floor=finite(float(np.sqrt(np.mean(np.square(fit.noise_floor))))),
        ratio=finite(fit.ratio),
        whiteness_p=finite(fit.whiteness_p),
        simulation_rmse=finite(fit.simulation_rmse),
        angle_error_rms_rad=finite(fit.angle_error_rms),
        rate_error_rms_rad_s=finite(fit.rate_error_rms),
        axes=tuple(
            Channel(innovation_rms=finite(rms), noise_floor=finite(floor))
            for rms, floor in zip(fit.innovation_rms, fit.noise_floor, strict=True)
        ),
        floor_from=fit.floor_from,
    )
