"""The observer with filterpy's ExtendedKalmanFilter doing prediction and update.

What its version 2.0.0 wants: columns (n, 1) throughout, since a flat z silently broadcasts; `predict` and then
`update`, since `predict_update` linearises at the wrong state; `predict_x` replaced by the nonlinear flow; and the
fading factor applied to P by hand, since the EKF has none.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from estimator.errors import ModelError
from estimator.oracle.numpy_observer import NumpyObserver
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings


class FilterpyObserver(NumpyObserver):
    """The oracle with P, K and the update by filterpy.  Raises ModelError for a stationary gain, which is no EKF."""

    backend = "filterpy"

    def __init__(
        self, device: Device, settings: ObserverSettings, controller: ControllerSettings | None = None
    ) -> None:
        if settings.gain is Gain.STATIONARY:
            raise ModelError("backend 'filterpy' has no stationary gain; use backend 'c' or 'numpy'")
        super().__init__(device, settings, controller)
        from filterpy.kalman import ExtendedKalmanFilter  # takes a second to import

        self._filter: Any = ExtendedKalmanFilter(dim_x=len(self.estimated_index), dim_z=device.axes)

    def _load(self) -> None:
        self._filter.x = self.x[self.estimated_index][:, None]
        self._filter.P = self._p.copy()

    def _store(self) -> None:
        self.x[self.estimated_index] = self._filter.x[:, 0]
        self._p[:] = self._filter.P

    def _predict(self, s: Array, f: Array, q: Array) -> None:
        self._load()

        def move(_: Any = None) -> None:
            self._filter.x = np.concatenate([s, self.x[self.estimated_index][self.states :]])[:, None]

        self._filter.predict_x = move
        self._filter.P *= self._fading_factor()
        self._filter.F, self._filter.Q = f, q
        self._filter.predict()
        self._store()

    def _update(self, z: Array, measure: Callable[[Array], Array], h: Array, assumed: Array, declared: Array) -> None:
        self._load()

        def predicted(column: Array) -> Array:
            x = self.x.copy()
            x[self.estimated_index] = column[:, 0]
            return measure(x)[:, None]

        self._filter.update(z[:, None], HJacobian=lambda _: h, Hx=predicted, R=assumed)
        self._correct(self._filter.K, h, declared, np.zeros(len(z)))  # C by the same gain; x comes from the filter
        self._store()
