"""A carriage run freely: output-error fit of its friction, which falls with the speed and differs there and back.

The force domain names what acts.  Its coefficients leave some hundredths of a newton, and a mass on no spring adds that
up: so they are refined by the error of a run that begins at rest and that nothing corrects, as the benchmark scores it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.side_by_side import side_by_side
from estimator.simulation import simulate
from evaluation.measured.inverse_dynamics import Motion
from evaluation.measured.refinement import Refined, refine

Effects = Mapping[str, Mapping[str, float]]

SPEEDS = (5e-3, 10e-3, 20e-3, 40e-3, 80e-3)
"""m/s: from several times what friction turns over in to well below the fastest that the carriage moves."""
_HALVED = 2  # times the step between speeds: to a quarter of an octave
_RUNS = 25  # of a fit; one that is not there by then is not the best
_CONSTANTS = ("dxx", "drive_gain_x")


@dataclass(frozen=True)
class Carriage:
    """A model of the carriage and its fitted free run; rmse [m] of the record it was fitted to."""

    observer: Observer
    fit: Refined

    @property
    def rmse(self) -> float:
        """Of the free run over the record it was fitted to, m for a sense gain of 1."""
        return float(self.fit.rmse[0])

    @property
    def physical(self) -> bool:
        """Whether every coefficient that has one sign only has it."""
        return all(
            not one.positive or self.fit.value(one.name) > 0.0
            for _, effect in self.observer.effects
            for one in effect.coefficients
        )

    def error_on(self, record: Record, first: int) -> Array:
        """Residual (n - first, 1) V of a run on another record that begins at rest; its first rows are not scored."""
        state = at_rest(self.observer, self.fit.state, record)
        run = simulate(self.observer, state, record.drive, step=record.step)
        return np.asarray(record.sense[first:] - run.sensed[first:])


def turnover(motion: Motion) -> float:
    """Median change of velocity, m/s, within the sample in which the carriage turns: what is slower than that, no
    record sampled so shows.

    Raises ModelError for a motion that never turns.
    """
    turns = np.flatnonzero(np.sign(motion.velocity[1:]) * np.sign(motion.velocity[:-1]) < 0)
    if len(turns) == 0:
        raise ModelError("the carriage never turns; give a record in which it goes there and back")
    return float(np.median(np.abs(motion.velocity[turns + 1] - motion.velocity[turns])))


def at_rest(observer: Observer, state: Array, record: Record) -> Array:
    """The state vector with a motion that begins at rest where the record does."""
    start = np.array(state, dtype=float)
    start[: observer.states] = 0.0
    start[0] = record.sense[0, 0] / observer.device.sense_gain[0]
    return start


def fitted(
    device: Device, settings: ObserverSettings, record: Record, constants: Mapping[str, float], effects: Effects
) -> Carriage:
    """The carriage with these effects, from these values on, by the error of its free run on `record`."""
    carried = {name: dict(values) for name, values in effects.items()}
    observer = Observer(device, replace(settings, effects=carried, initial=dict(constants)))
    coefficients = [c.name for _, effect in observer.effects for c in effect.coefficients]
    start = at_rest(observer, observer.state, record)
    free = (*_CONSTANTS, *coefficients)
    fit = refine(observer, record.sense, record.drive, start=start, free=free, step=record.step, runs=_RUNS)
    return Carriage(observer, fit)


def with_stribeck(
    device: Device,
    settings: ObserverSettings,
    record: Record,
    constants: Mapping[str, float],
    effects: Effects,
) -> Carriage:
    """The same with friction that falls with the speed beside `dry_friction`, at the speed that fits `record` best with
    coefficients of the right signs; from as much static friction more as there is dry friction.

    Raises ModelError where no speed does.
    """
    dry = effects["dry_friction"]

    def at(speed: float) -> Carriage | None:
        more = {"stribeck_friction": {"v0": dry["v0"], "vs": speed, "stx": dry["fx"]}}
        try:
            return fitted(device, settings, record, constants, {**effects, **more})
        except ModelError:
            return None

    runs = side_by_side([partial(at, speed) for speed in SPEEDS])
    known = {speed: run for speed, run in zip(SPEEDS, runs, strict=True) if run is not None and run.physical}
    if not known:
        raise ModelError("no friction that falls with the speed stays within bounds with the right signs")
    best = min(known, key=lambda speed: known[speed].rmse)
    step = float(np.log(SPEEDS[1] / SPEEDS[0]))
    for _ in range(_HALVED):
        step *= 0.5
        near = [best * float(np.exp(sign * step)) for sign in (-1.0, 1.0)]
        runs = side_by_side([partial(at, speed) for speed in near])
        known |= {speed: run for speed, run in zip(near, runs, strict=True) if run is not None and run.physical}
        best = min(known, key=lambda speed: known[speed].rmse)
    return known[best]
