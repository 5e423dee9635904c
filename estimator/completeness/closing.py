"""The scan that closes every run: what the model lacks, what the record excludes, how far the angle may be off."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from estimator.completeness.answer import Completeness, Lacking, Outcome
from estimator.completeness.information import Coefficient, Information
from estimator.completeness.lacking import HARMLESS, Taken, leading, tries
from estimator.completeness.stretch import Stretch, joined, settled_s, weighed_of
from estimator.completeness.turning import Turning
from estimator.completeness.words import Nearest, in_words
from estimator.effects.catalogue import effect_for
from estimator.effects.search import Search
from estimator.errors import ModelError
from estimator.record import Record
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings
from estimator.thresholds import THRESHOLDS
from estimator.trace.candidates import Parameters, kind, searched_by, watch_list
from estimator.trace.criterion import threshold
from estimator.trace.evidence import evidence
from estimator.trace.fitting import Fitted, coefficients_of, fit
from estimator.trace.judgement import unexplained
from estimator.trace.look import fresh, scanned_with
from estimator.trace.problem import Problem
from estimator.trace.scan import COURSE, PARTS, Scan, scan

_FEWEST_CYCLES = 100.0
_FEWEST_SAMPLES = 2000
_BESIDE = 0.1  # of the resonance
_ROUNDS = 3  # effects that are there and harmless are carried, and the record is looked at again
# Of what is watched with several parameters: near enough to the others to be seen by, and named.
_LABELS = {
    Search.LIMITS: ("2", "4", "6"),
    Search.BANDS: ("2", "4"),
    Search.LEVELS: ("2", "4"),
    Search.CORNERS: ("2",),
    Search.MODES: ("11", "21", "31"),
}

Progress = Callable[[str, int, int], None]


class Limits(NamedTuple):
    """What is held against a run.

    angle_rad: an effect that moves the angle by less is told and not held against the run; innovation_ratio: of the
    innovation to what is predicted of it, rms, up to which a model counts as one: what leaves more is not named.
    """

    angle_rad: float = 0.0
    innovation_ratio: float = 1.5


_STRICT = Limits()


def closing_scan(
    stretches: Sequence[Stretch],
    device: Device,
    settings: ObserverSettings,
    controller: ControllerSettings | None,
    *,
    scored_s: tuple[float, float],
    limits: Limits = _STRICT,
    declared: Mapping[str, float] = MappingProxyType({}),
    progress: Progress = lambda stage, done, total: None,
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
    device, settings = run.device, run.settings
    records = weighed_of(stretches)
    first = records[0]
    progress("scan", 0, 2 + _ROUNDS)
    problem = run.on(first)
    base = fit(problem)
    if not np.isfinite(base.likelihood):
        return Completeness(Outcome.UNKNOWN, "the observer does not converge on this record")
    watched = watched_of(first, device, base)
    progress("scan", 1, 2 + _ROUNDS)
    turning = turning_of(stretches, device, settings, run.controller, watched, scored_s)
    known = dict(watched)
    ratio: float | None = None
    lacks: tuple[Lacking, ...] = ()
    nearest: Nearest | None = None
    harmless: list[Taken] = []
    for done in range(_ROUNDS):
        progress("scan", 2 + done, 2 + _ROUNDS)
        carried = scanned_with(base, device, settings)
        seen = together([scan(problem.on(record).under(carried), watched, base.observer) for record in records])
        ratio = seen.ratio if ratio is None else ratio
        found = evidence(seen)
        serious = [
            item
            for item in found.values()
            if item.significance > threshold(len(found) * tries(watched[item.name], len(first)))
            and not _is_of_the_rate(watched[item.name], item.gain, device, seen)
        ]
        taken = (
            leading(problem, base, watched, seen, serious, turning, limits.innovation_ratio, declared)
            if serious
            else None
        )
        if taken is None:
            break
        if isinstance(taken, Nearest):
            nearest = taken
            break
        # Constants found one by one are found anew where all of them are.
        harmless = [item for item in harmless if not item.given.keys() & taken.given.keys()]
        if taken.angle.high >= HARMLESS * limits.angle_rad:
            lacks = taken.lacking
            break
        harmless.append(taken)
        if done == _ROUNDS - 1:
            break
        effects = coefficients_of(base.observer) | taken.given
        base = fit(problem.under(base.settings).carrying(effects))
        there = {kind(name) for name in taken.given}
        watched = {
            name: given
            for name, given in watched.items()
            if kind(name) not in there or (name not in taken.given and "omega" in given)
        }
    progress("scan", 2 + _ROUNDS, 2 + _ROUNDS)
    for item in harmless:
        turning = turning.with_shift(item.shift, item.deviation)
    small = tuple(item for one in harmless for item in one.lacking)
    left = () if lacks or nearest else unexplained(base, first, float(np.sqrt(device.target)) / (2.0 * np.pi))
    return Completeness(
        Outcome.LACKS if lacks or nearest or left else Outcome.COMPLETE,
        in_words(lacks, [one.lacking for one in harmless], left, len({kind(name) for name in known}), nearest),
        lacks, small, information_of(seen, turning, device), ratio,
    )  # fmt: skip


def watched_of(record: Record, device: Device, base: Fitted) -> dict[str, Parameters]:
    """The catalogue, as the record that `base` was fitted to suggests its parameters."""
    everything = watch_list(record, device, base.estimates.innovation, base.estimates.innovation_deviation)
    new = fresh(everything, base.settings.effects, float(np.sum(record.step)))
    return {name: given for name, given in new.items() if _is_watched(*name.partition(":")[::2])}


def _is_of_the_rate(parameters: Parameters, gain: float, device: Device, seen: Scan) -> bool:
    """Whether a line is what a rate leaves that moves otherwise than by a random walk: weak, beside the resonance."""
    beside = abs(parameters.get("omega", 0.0) / float(np.sqrt(device.target)) - 1.0) < _BESIDE
    return beside and gain < THRESHOLDS.judgement.rate_power * seen.innovation.size


def _is_watched(kind: str, label: str) -> bool:
    search = searched_by(kind)
    labels = None if search is None else _LABELS.get(search)
    return labels is None or label in labels


def together(scans: Sequence[Scan]) -> Scan:
    """One scan of several stretches."""
    return replace(
        scans[-1],
        normal=np.concatenate([one.normal for one in scans]),
        score=np.concatenate([one.score for one in scans]),
        innovation=np.concatenate([one.innovation for one in scans]),
        deviation=np.concatenate([one.deviation for one in scans]),
        course=np.concatenate([one.course for one in scans]),
    )


def turning_of(
    stretches: Sequence[Stretch],
    device: Device,
    settings: ObserverSettings,
    controller: ControllerSettings | None,
    watched: dict[str, Parameters],
    scored_s: tuple[float, float],
) -> Turning:
    """The angle's sensitivity to every watched coefficient, as the run's own observer has it."""
    if settings.gain is Gain.STATIONARY:  # its table would have to be made anew; it was made from such a filter
        settings = replace(settings, gain=Gain.FADING)
    times, courses = [], []
    # One that ends before the scored window says nothing of the angle in it, and turns while the observer settles.
    for stretch in [one for one in stretches[:-1] if one.end_s > scored_s[0]] + [stretches[-1]]:
        seen = scan(Problem(stretch.record, device, settings, controller), watched, weighed=False)
        elapsed = np.cumsum(stretch.record.step)
        edges = np.linspace(0, len(elapsed), PARTS + 1).astype(int)
        steps = np.arange(1, COURSE + 1) / COURSE
        ends = np.concatenate([begin + np.ceil(steps * (end - begin)) - 1 for begin, end in pairwise(edges)])
        time = stretch.begin_s + elapsed[ends.astype(int)]
        settled = time >= min(settled_s(stretch, settings, device, scored_s[0]), time[-1])
        times.append(time[settled])
        courses.append(seen.course[settled])
    time, sensitivity = joined(times, courses, scored_s[0], scored_s[1])
    return Turning(dict(seen.columns), time, sensitivity, np.zeros(len(time)), np.zeros(len(time)))


def information_of(seen: Scan, turning: Turning, device: Device) -> Information:
    """Normal equations of the scan beside the sensitivity of the angle, for what the scan watched."""
    coefficients: list[Coefficient] = []
    places: list[int] = []
    for name, columns in seen.columns.items():
        _, effect = effect_for(name, device.axes, device.own)
        places += range(turning.columns[name].start, turning.columns[name].stop)
        for c, plausible in zip(effect.coefficients, seen.plausible[columns], strict=True):
            coefficients.append(Coefficient(name, c.name.partition(":")[0], c.unit, float(plausible)))
    return Information(
        tuple(coefficients),
        seen.normal.sum(axis=0),
        seen.score.sum(axis=0),
        turning.time,
        np.asarray(turning.sensitivity.T[places]).T,
        max(seen.ratio, 1.0),
        np.hypot(turning.shift, turning.deviation),
    )
