"""The posterior Cramér–Rao bound of the rotation since an instant, φ = ∫Ω dt, along a known trajectory.

φ is one more state of the model beside the 13 (`estimator.rotation`); the recursion is that of `estimator.bound`
(Tichavský, Muravchik & Nehorai, IEEE Trans. Signal Processing 46(5), 1998) with that state in it.  An angle that is
read off the pattern and corrected for forces sample by sample obeys it too, but does not go back to what it took off
before it knew the constants better; this bound is that of an estimator that does.
"""

from dataclasses import replace

import numpy as np

from estimator.observer import Observer
from estimator.rotation import Recursion
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings

_CHUNK = 4096


def rotation_bound(
    device: Device, settings: ObserverSettings, truth: Array, *, every: int = 1, lost: Array | None = None
) -> tuple[Array, Array]:
    """Least deviations of φ since the settings' `reference` [rad] (rows,) and of the 13 states (rows, 13), SI, after
    every `every`-th sample.

    truth (n, 13) SI at each sample, evenly spaced, of a device of two axes; lost (n, 2) marks samples that carry no
    information.  The first step is linearised at the first sample.  Raises ModelError as the observer does.
    """
    observer = Observer(device, replace(settings, gain=Gain.EKF))
    recursion, n = Recursion(observer), len(truth)
    scaled = truth / observer.factors
    seen = np.ones((n, 2), bool) if lost is None else ~np.asarray(lost, bool)
    rotation, deviation = np.zeros(n), np.zeros((n, 13))
    before = np.concatenate([scaled[:1], scaled[:-1]])
    for first in range(0, n, _CHUNK):
        rows = slice(first, first + _CHUNK)
        found = recursion.go(before[rows], scaled[rows], seen[rows], np.zeros_like(scaled[rows, :2]))
        rotation[rows], deviation[rows] = found.deviation, found.states
    kept = slice(every - 1, None, every)
    return rotation[kept] / device.angular_gain, deviation[kept] * np.abs(observer.factors)
