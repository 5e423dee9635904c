"""From a record that the model does not explain to the force that it lacks, and its form.

Nothing here knows the catalogue of effects: the base model, the drive and what was sensed are all that is asked.
"""

from dataclasses import dataclass, replace

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.diagnosis import Interval
from estimator.effects.declaration import si_unit
from estimator.errors import ModelError
from estimator.missing_force.following import follow
from estimator.missing_force.latent import Latent
from estimator.missing_force.law import Law, constants_alone, part_of, propose, with_constants
from estimator.missing_force.laws import laws
from estimator.missing_force.library import Term
from estimator.missing_force.linear import Linear, scaled_constants
from estimator.missing_force.points import Points, points_of
from estimator.missing_force.readings import Readings, readings_of
from estimator.missing_force.result import Form, FormTerm, MissingForce
from estimator.missing_force.smoother import Smoothed, chosen, euler, smooth
from estimator.missing_force.switching import Levels, levels_of
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Sensed
from estimator.trace.filtered import Filtered
from estimator.trace.fit import fit
from estimator.trace.likelihood import ObserverLayout, observer_of
from estimator.trace.problem import Problem
from estimator.trace.start import begin_moving

_BEFORE, _AFTER = 120_000, 80_000  # samples on either side of the split
_CHOICE = 30_000  # of those before it, by which the form is chosen
_UNEVEN = 1e-3  # largest spread of the steps
_LEAST_NOISE = 1e-16
_FOLLOWED = 16.0  # cycles within which the filter that judges forgets the motion
_SETTLED = 30.0  # cycles at the beginning that say nothing of the form


@dataclass(frozen=True, eq=False)
class _Stretch:
    """The part of a record that is looked at; in `linear` readings that say less than they seem are lost, in `sense`
    (n, axes) they are there.
    """

    observer: Observer
    linear: Linear
    temperature: Array | None
    first: int
    split: int
    force_noise: float
    rate_intensity: float
    sense: Array
    readings: Readings

    @property
    def choice(self) -> slice:
        """Rows by which the form is chosen."""
        begin = max(self.split - _CHOICE, 0)
        cycle = 2.0 * np.pi / self.linear.step
        return slice(begin + min(int(_SETTLED * cycle), (self.split - begin) // 5), self.split)

    @property
    def held_out(self) -> slice:
        """Rows that the form is judged by."""
        return slice(self.split, len(self.linear.sense))


def missing_force(problem: Problem, split: int) -> MissingForce:
    """The force that the model of `problem` lacks; its form chosen before `split`, judged behind it.

    Of a long record the 120,000 samples before the split and the 80,000 behind it are looked at.  Raises ModelError
    where a channel shows no displacement, the samples are not evenly spaced, or no filter follows the record.
    """
    stretch, latent, seen = _followed(_stretch(problem, split))
    levels = levels_of(stretch.linear, latent, euler(stretch.linear, seen.motion), stretch.force_noise)
    if any(levels.flips):
        # Constants and motion anew without them: a filter takes a step of the offset for a force, and a fit for both.
        stretch, latent, seen = _followed(_stretch(problem, split, levels))
    rows = stretch.choice
    points = _points(stretch, seen, slice(max(stretch.split - _CHOICE, 0), stretch.split))
    own = slice(rows.start - max(stretch.split - _CHOICE, 0), len(points.motion))
    alone = constants_alone(points, stretch.force_noise, stretch.rate_intensity, own)
    law = propose(points, stretch.force_noise, stretch.rate_intensity, own)
    whole = _points(stretch, seen, slice(0, len(stretch.linear.sense)))
    was, now = (_ratio(stretch, whole, one) for one in (alone, law))
    if not now < was:
        law, now = alone, was
    drawn = _smoothed(stretch, whole, law, latent, pushes=False)
    after = _smoothed(stretch, whole, law, latent, pushes=True) if law.terms else drawn
    return _seen(stretch, drawn, after, law, was, now)


def _followed(stretch: _Stretch) -> tuple[_Stretch, Latent, Smoothed]:
    """With the rate as the record has it, the latent force, and what both make of the motion."""
    linear = stretch.linear
    latent = chosen(linear, None, stretch.force_noise, rows=stretch.choice)
    seen = smooth(linear, latent, None, stretch.force_noise)
    linear = _turned(linear, seen.motion, Law((), (), np.zeros((0, 0)), {}, 0.0 * linear.offset, 0.0, 1e-6), stretch)
    return (
        replace(stretch, linear=linear),
        latent,
        smooth(linear, latent, euler(linear, seen.motion), stretch.force_noise),
    )


def _stretch(problem: Problem, split: int, levels: Levels | None = None) -> _Stretch:
    """What is looked at, with levels of the readings where they are known."""
    record = problem.record
    first, last = max(split - _BEFORE, 0), min(split + _AFTER, len(record))
    record = record.part(slice(first, last))
    step = record.step[1:]
    if any(sensed is not Sensed.DISPLACEMENT for sensed in problem.device.sensed):
        raise ModelError("a channel shows no displacement")
    if not len(step) or float(np.ptp(step)) > _UNEVEN * float(np.mean(step)):
        raise ModelError("the samples are not evenly spaced")
    volts = readings_of(record.sense[: split - first], np.array(problem.device.noise))
    hidden = volts.hide(record.sense, np.array(problem.device.noise))
    levels = levels or Levels(np.zeros_like(record.sense), np.zeros(problem.device.axes), (0,) * problem.device.axes)
    shifted = levels.half * levels.path
    unit = Observer(problem.device, problem.settings).volts
    clear = np.where(hidden[:, None], np.nan, record.sense - shifted * unit)
    found = _constants(problem.on(replace(record, sense=clear).part(slice(0, split - first))).carrying({}))
    observer = Observer(problem.device, replace(problem.settings, effects={}))
    scaled = scaled_constants(observer, found)
    z, u, h, _ = observer.scaled(record.sense, record.drive, record.step, None)
    axes = problem.device.axes
    linear = Linear(
        sense=np.where(hidden[:, None], np.nan, z - shifted),
        drive=u,
        step=float(np.mean(h[1:])),
        noise=np.array(problem.device.noise) / np.abs(observer.volts),
        constants={name: value for name, value in scaled.items() if not name.startswith("phi")},
        offset=np.array([scaled[name] for name in ("phi_x", "phi_y")[:axes]]),
        rate=np.zeros(len(z)),
    )
    names = list(observer.estimated)
    intensity = observer.random_walk_intensity
    return _Stretch(
        observer=observer,
        linear=linear,
        temperature=record.channels.get("temperature"),
        first=first,
        split=split - first,
        force_noise=float(observer.force_noise[0]) + _LEAST_NOISE,
        rate_intensity=float(intensity[names.index("rate") - observer.states]) if "rate" in names else 0.0,
        sense=z,
        readings=replace(volts.scaled(unit), levels=levels.path, flips=levels.flips),
    )


def _constants(problem: Problem) -> dict[str, float]:
    """Constants of the base model by maximum likelihood, SI, with the sense offsets that its filter comes to; as they
    are declared where no filter follows the record.
    """
    model = fit(Filtered(problem), {})
    layout, record = model.layout, problem.record
    assert isinstance(layout, ObserverLayout)
    observer = observer_of(problem, {}, model.model.noise if model.evaluation.sound else None)
    if model.evaluation.sound:
        observer.x[observer.states + layout.index] = model.model.theta[: len(layout.index)]
        begin_moving(observer, record)
        observer.run(record.sense, record.drive, step=record.step, temperature=record.channels.get("temperature"))
    names = observer.model.names[observer.states :]
    values = observer.state[observer.states : len(observer.model.names)].tolist()
    return {name: value for name, value in zip(names, values, strict=True) if name != "rate"}


def _turned(
    linear: Linear, motion: Array, law: Law, stretch: _Stretch, known: tuple[Array, Array] | None = None
) -> Linear:
    """With the rate as the record has it beside a law; a single axis has none."""
    if linear.axes == 1:
        return linear
    pushed, sensed = known or (np.zeros_like(motion), np.zeros((len(motion), 2)))
    found = follow(
        replace(linear, rate=np.zeros(len(motion))), motion, pushed, sensed, law.force_noise, stretch.rate_intensity
    )
    return replace(linear, rate=found.rate) if np.all(np.isfinite(found.rate)) else linear


def _points(stretch: _Stretch, seen: Smoothed, rows: slice) -> Points:
    warm = stretch.temperature
    temperature = None if warm is None else warm[rows] - warm[0]
    linear = replace(part_of(stretch.linear, rows), sense=stretch.sense[rows])
    readings = stretch.readings.part(rows)
    return points_of(linear, seen.motion[rows], seen.force[rows], temperature, readings, rows.start)


def _smoothed(stretch: _Stretch, points: Points, law: Law, begin: Latent, *, pushes: bool) -> Smoothed:
    """What force is missing with the constants that go with a law, and, where it pushes, beside it."""
    pushed, sensed = law.pushed(points)
    linear = with_constants(points.linear, law)
    linear = _turned(linear, points.motion, law, stretch, (pushed, sensed))
    linear = replace(linear, sense=linear.sense - sensed)
    known = euler(linear, points.motion) + (pushed if pushes else 0.0)
    noise = stretch.force_noise
    latent = chosen(linear, known, noise, rows=stretch.held_out, begin=begin)
    return smooth(linear, latent, known, noise)


def _ratio(stretch: _Stretch, points: Points, law: Law) -> float:
    """Innovation of the part held out over what the filter expects, rms, with constants and coefficients of the other
    part; the filter follows the rate, and forgets the motion within some cycles.
    """
    linear = with_constants(points.linear, law)
    forgets = 1.0 / (2.0 * np.pi * _FOLLOWED)
    density = max(stretch.force_noise, 4.0 * float(np.mean(linear.noise**2)) * linear.step * forgets**2)
    found = follow(linear, points.motion, *law.pushed(points), density, stretch.rate_intensity)
    there = np.all(np.isfinite(linear.sense), axis=1)
    there[: stretch.held_out.start] = False
    ratio = found.innovation[there] / found.deviation[there]
    return float(np.sqrt(np.mean(ratio**2))) if ratio.size and np.all(np.isfinite(ratio)) else np.inf


def _left(was: float, now: float) -> float:
    """Share of the force that a form leaves, rms over rms: by what stands above the noise."""
    if not was > 1.0:
        return 1.0
    return float(np.sqrt(max(now**2 - 1.0, 0.0) / (was**2 - 1.0)))


def _seen(stretch: _Stretch, drawn: Smoothed, after: Smoothed, law: Law, was: float, now: float) -> MissingForce:
    scaling, linear = stretch.observer.scaling, stretch.linear
    length, speed = scaling.length, scaling.length * scaling.omega0
    force = speed * scaling.omega0
    gain = linear.constants.get("drive_gain_x", 1.0) + law.constants.get("drive_gain_x", 0.0)
    driven = (linear.drive @ np.ones(linear.drive.shape[2])) * gain
    return MissingForce(
        first=stretch.first,
        time=np.asarray((stretch.first + np.arange(len(driven))) * linear.step / scaling.omega0),
        position=drawn.motion[:, ::2] * length,
        velocity=drawn.motion[:, 1::2] * speed,
        drive=driven * force,
        force=drawn.force * force,
        deviation=drawn.force_deviation * force,
        left=after.force * force,
        left_deviation=after.force_deviation * force,
        temperature=stretch.temperature,
        there=np.all(np.isfinite(linear.sense), axis=1),
        split=stretch.split,
        form=Form(_terms(law, length, scaling.omega0), _left(was, now), was, now),
    )


def _terms(law: Law, length: float, omega: float) -> tuple[FormTerm, ...]:
    found, first = [], 0
    deviations = np.sqrt(np.maximum(np.diagonal(law.covariance), 0.0))
    for term, values in zip(law.terms, law.coefficients, strict=True):
        own = deviations[first : first + len(values)]
        first += len(values)
        found.append(in_si(term, values, own, length, omega))
    return tuple(found)


def in_si(term: Term, values: Array, deviations: Array, length: float, omega: float) -> FormTerm:
    """The term with its scaled coefficients and their standard deviations, in SI; `length` in m, `omega` in rad/s."""
    meters, seconds = (1 - term.length, -term.time) if term.sense else (1 - term.length, -2 - term.time)
    scale = length**meters * omega**-seconds
    unit = si_unit(int(meters), int(seconds))
    if term.form.startswith("T"):
        unit = f"1/({unit.removeprefix('1/')}·K)" if unit.startswith("1/") else f"{unit}/K"
    given = {}
    for name, value, deviation in zip(term.labels, values * scale, TWO_SIDED * deviations * scale, strict=True):
        given[name] = Interval(float(value), float(value - deviation), float(value + deviation), unit)
    inside = {}
    if term.threshold is not None:
        name, value, powers, times = term.threshold
        at = value * length**powers * omega**-times
        inside[name] = Interval(at, at, at, "rad/s" if name == "w" else si_unit(powers, times))
    return FormTerm(term.form, term.sense, given, inside, laws(term))
