"""The scan that closes every run: what the model lacks, what the record excludes, how far the angle may be off."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from estimator.completeness.answer import Completeness, Lacking, Outcome
from estimator.completeness.constants import calibrated_effects, off
from estimator.completeness.information import Information, ScannedCoefficient
from estimator.completeness.lacking import HARMLESS, Taken, freed, leader, leading, taken_together
from estimator.completeness.scores import Scores, scores_of
from estimator.completeness.stretch import Stretch, joined, settled_s, weighed_of
from estimator.completeness.stretched import Stretched, beside, fitted, likelihood_of
from estimator.completeness.turning import Turning, followed, instants, moved
from estimator.completeness.words import Nearest, in_words
from estimator.effects.labels import kind, searched_by
from estimator.effects.search import Search
from estimator.errors import ModelError
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, Variant
from estimator.side_by_side import together
from estimator.trace.checks import disturbed_by
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import is_searched
from estimator.trace.named import constants_of
from estimator.trace.problem import Effects, Problem, Progress, unseen
from estimator.trace.score_test import Score
from estimator.trace.search import margin as margin_of
from estimator.trace.search import shortlisted

_FEWEST_CYCLES = 100.0
_FEWEST_SAMPLES = 2000
_BESIDE = 0.1  # of the resonance
_OF_THE_RATE = 1e-2  # of the power: a weaker line beside the resonance is what a rate leaves that jumps
_FOLLOWED = 1e-3  # of the target stiffness, and per √s: wide beside what a record leaves of it; so is a tenth of it
_ROUNDS = 3  # effects that are there and harmless are included in the model, and the record is tested again
# Of what is tested with several parameters: near enough to the others to be seen by, and named.
_LABELS = {
    Search.LIMITS: ("2", "4", "6"),
    Search.BANDS: ("2", "4"),
    Search.LEVELS: ("2", "4"),
    Search.CORNERS: ("2",),
    Search.LAGS: ("1",),
    Search.MODES: ("11", "21", "31"),
}


class Limits(NamedTuple):
    """What is held against a run.

    angle_rad: an effect that moves the angle by less is told and not held against the run; innovation_ratio: of the
    innovation to what is predicted of it, rms, up to which a model counts as one: what leaves more is not named.
    """

    angle_rad: float = 0.0
    innovation_ratio: float = 1.5


_STRICT = Limits()
WORTH = 0.5
"""Of the margin, that the score test has to tell of an effect which is fitted."""


def closing_scan(
    stretches: Sequence[Stretch],
    device: Device,
    settings: ObserverSettings,
    controller: ControllerSettings | None,
    *,
    scored_s: tuple[float, float],
    limits: Limits = _STRICT,
    declared: Mapping[str, float] = MappingProxyType({}),
    progress: Progress = unseen,
) -> Completeness:
    """Judge a run by stretches of its record (`stretches_of`), with the observer settings of the run.

    scored_s: first and last scored instant, s from the start of the run; declared: standard deviations of the
    calibration's constants, SI, by symbol of the catalogue.  Never raises for a record that cannot be judged: the
    outcome is then unknown, with the reason.
    """
    samples = sum(len(stretch.record) for stretch in stretches)
    seconds = sum(float(np.sum(stretch.record.step)) for stretch in stretches)
    try:
        require_scannable(stretches, device)
        with np.errstate(all="ignore"):
            answer = _scanned(
                stretches,
                Problem(stretches[0].record, device, settings, controller),
                scored_s,
                limits,
                declared,
                progress,
            )
    except (ModelError, np.linalg.LinAlgError) as error:
        return Completeness(Outcome.UNKNOWN, f"not scanned: {error}", samples=samples, seconds=seconds)
    return replace(answer, samples=samples, seconds=seconds)


def require_scannable(stretches: Sequence[Stretch], device: Device) -> None:
    """ModelError with the reason where a record says nothing of a model."""
    if device.axes != 2:
        raise ModelError("a single axis has no angle; hil trace judges its model")
    if not stretches:
        raise ModelError("a single sample is too few")
    first = stretches[0].record
    cycles = float(np.sum(first.step)) * np.sqrt(device.target) / (2.0 * np.pi)
    if cycles < _FEWEST_CYCLES or len(first) < _FEWEST_SAMPLES:
        raise ModelError(f"{len(first)} samples, {cycles:.3g} cycles of the resonance, are too few")
    for stretch in stretches:
        sensed = np.isfinite(stretch.record.sense)
        if np.mean(sensed) < 0.5:
            raise ModelError(f"{1.0 - np.mean(sensed):.0%} of the samples are lost")
        moved = np.sqrt(np.nanmean(stretch.record.sense**2, axis=0))
        if not np.all(np.isfinite(stretch.record.drive)) or not np.all(moved > 0.0):
            raise ModelError("a sense channel is dead")


def _scanned(
    stretches: Sequence[Stretch],
    run: Problem,
    scored_s: tuple[float, float],
    limits: Limits,
    declared: Mapping[str, float],
    progress: Progress,
) -> Completeness:
    """`run` has the settings of the run's observer."""
    device, rounds = run.device, 2 + _ROUNDS
    progress("scan", 0, rounds)
    of = likelihood_of(run, weighed_of(stretches))
    bare = base = fitted(of, of.effects, limits.innovation_ratio)
    if not base.evaluation.sound:
        return Completeness(Outcome.UNKNOWN, "the observer does not converge on this record")
    tested = tested_of(of, base)
    constants = calibrated_effects(declared, tested, device)
    if constants:
        of = replace(of, known=declared)
        base = beside(of, base, {name: {} for name in constants}, limits.innovation_ratio)
    effects: Effects = {name: given for name, given in tested.items() if name not in constants}
    margin = margin_of(len({kind(name) for name in tested}))
    progress("scan", 1, rounds)
    if run.settings.by_loops:
        run = as_loops(run, constants_of(base))
    seen, turning = together(
        lambda: scores_of(of, base, effects, constants),
        lambda: turning_of(stretches, run, tested, scored_s),
    )

    def move(effects: Effects) -> Array:
        return course_of(stretches, run, scored_s, lambda problem: moved(problem, effects))[1][:, 0]

    ratio = seen.ratio
    lacks: tuple[Lacking, ...] = ()
    nearest: Nearest | None = None
    harmless: list[Taken] = []
    for done in range(_ROUNDS):
        progress("scan", 2 + done, rounds)
        serious = serious_of(of, seen, effects, margin)
        beyond = freed(of, bare, base, constants, limits.innovation_ratio)
        first = leader(of, base, serious, beyond, margin)
        most = limits.innovation_ratio, margin
        found = None if first is None else leading(of, base, first, seen, constants, turning, move, most)
        if isinstance(found, Nearest):
            nearest = found
        elif found is not None and found.angle.high >= HARMLESS * limits.angle_rad:
            lacks = found.lacking
        if found is None or lacks or nearest:
            break
        assert isinstance(found, Taken)
        assert found.model is not None
        harmless.append(found)
        base = found.model
        if found.freed:
            of, constants = of.freeing(found.freed), tuple(name for name in constants if name != found.freed)
        effects = beside_those(effects, base.model.effects)
        seen = scores_of(of, base, effects, constants)
    progress("scan", rounds, rounds)
    for item in harmless:
        turning = turning.with_shift(item.shift, item.deviation)
    information = information_of(seen, turning, of)
    shown = None if lacks or nearest else off(information, constants, declared, device, margin)
    if shown is not None:
        all_of_them = taken_together(shown, turning, device, HARMLESS * limits.angle_rad)
        if all_of_them.angle.high >= HARMLESS * limits.angle_rad:
            lacks = all_of_them.lacking
        else:
            harmless.append(all_of_them)
    small = tuple(item for one in harmless for item in one.lacking)
    left = () if lacks or nearest else left_by(base, of)
    return Completeness(
        Outcome.LACKS if lacks or nearest or left else Outcome.COMPLETE,
        in_words(lacks, [one.lacking for one in harmless], left, len({kind(name) for name in tested}), nearest),
        lacks, small, information, ratio,
    )  # fmt: skip


def tested_of(of: Stretched, base: FittedModel) -> dict[str, Mapping[str, float]]:
    """The catalogue, as the record that `base` was fitted to suggests its parameters."""
    everything = of.candidates(base.model, base.evaluation.shown(slice(0, of.samples)))
    return {name: given for name, given in everything.items() if _is_tested(*name.partition(":")[::2])}


def beside_those(tested: Effects, there: Effects) -> Effects:
    """What is tested beside effects that are there: a line or a mode may come again at another frequency."""
    kinds = {kind(name) for name in there}
    return {
        name: given
        for name, given in tested.items()
        if name not in there and (kind(name) not in kinds or "omega" in given)
    }


def serious_of(of: Stretched, seen: Scores, effects: Effects, margin: float) -> list[Score]:
    """The best of each kind, the largest gain first, of those that may stand better by the margin once fitted, what
    their numbers cost taken off.
    """
    return shortlisted([
        score for score in seen.table
        if score.robust - price(of, score, seen.samples) > WORTH * margin
        and not _is_of_the_rate(effects[score.name], score.gain, of, seen)
    ], 0.0)  # fmt: skip


def price(of: Stretched, score: Score, samples: int) -> float:
    """What the numbers of an effect cost in twice the log-likelihood (Schwarz, Annals of Statistics 6, 1978)."""
    searched = sum(is_searched(parameter, score.given) for parameter in of.effect(score.name).parameters)
    return float((len(score.size) + searched) * np.log(samples))


def _is_of_the_rate(parameters: Mapping[str, float], gain: float, of: Stretched, seen: Scores) -> bool:
    """Whether a line is what a rate leaves that moves otherwise than by a random walk: weak, beside the resonance."""
    beside = abs(parameters.get("omega", 0.0) / float(np.sqrt(of.problem.device.target)) - 1.0) < _BESIDE
    return beside and gain < _OF_THE_RATE * seen.samples


def _is_tested(kind: str, label: str) -> bool:
    search = searched_by(kind)
    labels = None if search is None else _LABELS.get(search)
    return labels is None or label in labels


def as_loops(run: Problem, constants: Mapping[str, float]) -> Problem:
    """The problem of an observer whose angle moves as that of the classic loops: it begins with the constants that the
    record shows, and its springs follow whatever the phase and the quadrature loop null.
    """
    settings = run.settings
    return run.under(
        replace(
            settings,
            variant=Variant.FULL,
            initial={**settings.initial, **constants},
            spread=replace(settings.spread, stiffness=_FOLLOWED),
            process_noise=replace(settings.process_noise, stiffness=_FOLLOWED, damping=0.0),
        )
    )


def turning_of(stretches: Sequence[Stretch], run: Problem, tested: Effects, scored_s: tuple[float, float]) -> Turning:
    """The angle's sensitivity to every tested coefficient, as the observer of `run` has it."""
    columns: dict[str, slice] = {}

    def follow(problem: Problem) -> Array:
        found, course = followed(problem, tested)
        columns.update(found)
        return course

    time, sensitivity = course_of(stretches, run, scored_s, follow)
    return Turning(columns, time, sensitivity, np.zeros(len(time)), np.zeros(len(time)))


def course_of(
    stretches: Sequence[Stretch], run: Problem, scored_s: tuple[float, float], follow: Callable[[Problem], Array]
) -> tuple[Array, Array]:
    """Time (m,) and course (m, k) over the scored window of what `follow` has (instants, k) of a stretch's angle, with
    the observer of `run`.
    """
    device, settings, controller = run.device, run.settings, run.controller
    if settings.gain is Gain.STATIONARY:  # its table would have to be made anew; it was made from such a filter
        settings = replace(settings, gain=Gain.FADING)
    times, courses = [], []
    # One that ends before the scored window says nothing of the angle in it, and turns while the observer settles.
    for stretch in [one for one in stretches[:-1] if one.end_s > scored_s[0]] + [stretches[-1]]:
        course = follow(Problem(stretch.record, device, settings, controller))
        time = stretch.begin_s + np.cumsum(stretch.record.step)[instants(len(stretch.record))]
        settled = time >= min(settled_s(stretch, settings, device, scored_s[0]), time[-1])
        times.append(time[settled])
        courses.append(course[settled])
    return joined(times, courses, *scored_s)


def information_of(seen: Scores, turning: Turning, of: Stretched) -> Information:
    """Normal equations of the scan beside the sensitivity of the angle, for what the scan tested."""
    coefficients: list[ScannedCoefficient] = []
    places: list[int] = []
    for name, columns in seen.columns.items():
        places += range(turning.columns[name].start, turning.columns[name].stop)
        for c, plausible in zip(of.effect(name).coefficients, seen.plausible[columns], strict=True):
            coefficients.append(ScannedCoefficient(name, c.name.partition(":")[0], c.unit, float(plausible)))
    return Information(
        tuple(coefficients), seen.normal, seen.score, turning.time, np.asarray(turning.sensitivity.T[places]).T,
        seen.widening, np.hypot(turning.shift, turning.deviation),
    )  # fmt: skip


def left_by(base: FittedModel, of: Stretched) -> tuple[str, ...]:
    """What a model leaves in the first stretch that is of a size that matters: the check of a trace."""
    first = of.part(slice(0, of.samples))
    quiet, disturbed = first.disturbed(base.layout, first.quieten(base.layout, base.model))
    seen = [first.evaluate(base.layout, one, derivatives=False) for one in (quiet, disturbed)]
    check = disturbed_by(*seen)
    return () if check.passed else (check.sentence,)
