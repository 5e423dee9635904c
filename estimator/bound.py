"""The posterior Cramér–Rao bound of a record: how well any unbiased estimator could know state, rate and pattern angle.

With additive Gaussian noise the bound's information matrix obeys the Riccati recursion of the extended Kalman filter,
linearised along the *true* trajectory instead of the estimated one (Tichavský, Muravchik & Nehorai, IEEE Trans. Signal
Processing 46(5), 1998; Taylor, 1979, for the deterministic trajectory).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.oracle.evaluation import evaluated
from estimator.oracle.flow import backward
from estimator.oracle.pattern import pattern_gradient
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings, Variant


@dataclass(frozen=True)
class Bound:
    """Least standard deviations after the samples `index`, SI.

    deviation (rows, states + constants), zero for what is not estimated; angle (rows,) [rad], the pattern angle θ by
    the corrected formula, zeros for a single axis.
    """

    names: tuple[str, ...]
    index: NDArray[np.int64]
    deviation: Array
    angle: Array

    def of(self, name: str) -> Array:
        """Column of `deviation` by name."""
        return np.asarray(self.deviation[:, self.names.index(name)])


def posterior_bound(
    device: Device,
    settings: ObserverSettings,
    truth: Array,
    drive: Array,
    *,
    step: Array | None = None,
    lost: NDArray[np.bool_] | None = None,
    every: int = 1,
    virtual_rotation: float = 0.0,
) -> Bound:
    """Bound along truth (n, states + constants) SI at each sample, under drive and step as `Observer.run` takes them.

    Noise and process noise are those declared, and must be those of the record; the prior is the initial spread about
    the true state one interval before the first sample.  lost (n, axes) marks samples that carry no information;
    virtual_rotation [rad/s] is that of the frame in which the angle is read.

    Raises ModelError when truth and drive are of unequal length or truth has another number of columns than the model.
    """
    spread = settings.spread
    if settings.variant is Variant.GYRO:
        spread = replace(spread, offset=0.0)  # the bound is that of a board on which the variant's assumption holds
    observer = Observer(device, replace(settings, gain=Gain.EKF, spread=spread))
    n, axes = len(drive), device.axes
    if np.shape(truth) != (n, len(observer.x)):
        raise ModelError(f"truth has shape {np.shape(truth)}; {n} rows of {', '.join(observer.names)} are needed")
    polynomials = np.asarray(drive, dtype=float).reshape(n, axes, -1)
    h = np.full(n, 1.0 / device.sample_rate) if step is None else np.asarray(step, dtype=float)
    before = np.concatenate([_one_earlier(observer, truth[0], polynomials[0], h[0])[None], truth[:-1]])
    sense = np.zeros((n, axes)) if lost is None else np.where(lost, np.nan, 0.0)
    index = np.arange(every - 1, n, every)
    deviation = np.zeros((len(index), len(observer.x)))
    angle = np.zeros(len(index))
    for row, last in enumerate(index):
        part = slice(last - every + 1, last + 1)
        observer.run(sense[part], polynomials[part], step=h[part], every=every, truth=before[part])
        covariance = observer.covariance
        deviation[row, observer.estimated_index] = np.sqrt(np.diag(covariance))
        if axes == 2:
            angle[row] = _angle_deviation(observer, covariance, truth[last], virtual_rotation)
    return Bound(observer.names, index, deviation, angle)


def _one_earlier(observer: Observer, truth: Array, drive: Array, step: float) -> Array:
    """The true state vector one interval before the first sample, by the base model's flow backwards: where an effect
    acts, the first step alone is linearised that little beside the truth.
    """
    x = truth / observer.factors
    states = observer.states
    u, h = drive / observer.scaling.drive, step * observer.scaling.omega0
    constants = x[states : len(observer.model.names)]
    x[:states] = backward(evaluated(observer.number), constants, x[:states], u, h)
    return np.asarray(x * observer.factors)


def _angle_deviation(observer: Observer, covariance: Array, truth: Array, virtual_rotation: float) -> float:
    """√(∇θᵀ P ∇θ) at the truth; covariance over the estimated entries, SI."""
    rate = observer.model.names.index("rate")
    entries = [*range(observer.states), int(np.flatnonzero(observer.estimated_index == rate)[0])]
    scale = observer.factors[[*range(observer.states), rate]]
    x = truth / observer.factors
    w = x[rate] + virtual_rotation / observer.scaling.omega0
    gradient = pattern_gradient(x[: observer.states], 1.0, w, float(x[rate])) / scale
    return float(np.sqrt(gradient @ covariance[np.ix_(entries, entries)] @ gradient))
