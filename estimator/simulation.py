"""Free-run simulation: what the model says a record should have been, given only its start and its drive.

An innovation judges a model over one sample, a free run over the whole record: errors add up, nothing corrects them.
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.core.free_run import free_run
from estimator.core.taylor import taylor_order
from estimator.effects.declaration import Effect, Source
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.scaling import Array

_REMEMBERED = (Source.TEMPERATURE, Source.INTEGRAL, Source.RESONATOR, Source.LAG, Source.WANE)
_LONGEST = 0.3  # of 1/ω0, the longest part of a step: an effect of 15 % is then integrated to 3e-6 of the amplitude


@dataclass(frozen=True)
class Simulation:
    """Sensed volts (n, axes), and their derivative by the state vector (n, axes, states + constants) in V per SI unit;
    0 rows of it unless asked for.
    """

    sensed: Array
    sensitivity: Array


def remembers(effect: Effect) -> bool:
    """Whether an effect depends on drives or readings of the past, which only the filter's pass carries."""
    return effect.delayed is not None or any(signal.source in _REMEMBERED for signal in effect.signals)


def simulate(
    observer: Observer,
    state: Array,
    drive: Array,
    *,
    step: Array | None = None,
    sensitive: bool = False,
    ago: float = 0.0,
) -> Simulation:
    """Run the observer's model freely over n samples; the observer itself is neither used nor changed.

    state (states + constants,) SI in the order of `observer.names`: the state at the first sample, then the constants
    and the effects' coefficients; drive (n, axes) or (n, axes, degree + 1) and step (n,) [s] as for `Observer.run`: row
    m acted over the interval that ends at sample m, so that row 0 moves nothing; ago [s]: when, before the first
    sample, the time of lines began.

    Raises ModelError for arrays that do not fit, for a step too long for the flow, for effects with a delay or a memory
    of their own, and for a run that leaves all bounds.
    """
    for _, effect in observer.effects:
        if remembers(effect):
            raise ModelError(f"effect {effect.name} depends on the past and cannot be run freely; leave it out")
    n, axes = len(drive), observer.device.axes
    if len(state) != len(observer.names):
        raise ModelError(
            f"a state of {len(state)} entries; expected {len(observer.names)}: " + ", ".join(observer.names)
        )
    if step is not None and len(step) != n:
        raise ModelError(f"step has {len(step)} rows, drive has {n}; give each sample its own")
    u = np.ascontiguousarray(np.asarray(drive, dtype=float).reshape(n, axes, -1) / observer.scaling.drive)
    h = np.full(n, observer.h) if step is None else np.asarray(step, dtype=float) * observer.scaling.omega0
    longest = float(np.max(h, initial=observer.h))
    # The damping may exceed the stiffness many times over (a carriage); its rate then sets the length of a part.
    stiff = max(1.0, float(np.max(np.abs(_rates(observer, state)), initial=0.0)))
    parts = max(1, math.ceil(longest * stiff / _LONGEST)) if observer.effects else 1
    order = taylor_order(longest / parts, norm=1.5 * stiff) + u.shape[2] - 1
    x = np.asarray(state, dtype=float) / observer.factors
    sensed, sensitivity = free_run(
        observer, x, u, h, order=order, parts=parts, sensitive=sensitive, time=ago * observer.scaling.omega0
    )
    if not np.all(np.isfinite(sensed)):
        row = int(np.argmin(np.all(np.isfinite(sensed), axis=1)))
        raise ModelError(f"the free run leaves all bounds at sample {row}; start nearer, or bound the coefficients")
    if not np.all(np.isfinite(sensitivity)):
        raise ModelError("the free run's derivatives leave all bounds; start nearer, or bound the coefficients")
    volts = np.array([observer.scaling.sense(axis) for axis in range(axes)])
    return Simulation(sensed * volts, sensitivity * volts[:, None] / observer.factors)


def _rates(observer: Observer, state: Array) -> Array:
    """Scaled damping rates of the model's constants at `state`."""
    scaled = np.asarray(state) / observer.factors
    return np.array([scaled[observer.names.index(name)] for name in ("dxx", "dyy") if name in observer.names])
