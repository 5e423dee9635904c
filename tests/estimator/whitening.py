"""What makes the innovations of both channels white together, by the observer in plain NumPy."""

import numpy as np

from estimator.oracle.numpy_observer import NumpyObserver
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, ObserverSettings


class _Joint(NumpyObserver):
    """Keeps the roots (axes, axes) of the covariances of its innovations, V."""

    def __init__(self, device: Device, settings: ObserverSettings, controller: ControllerSettings | None) -> None:
        super().__init__(device, settings, controller)
        self.roots: list[Array] = []

    def _correct_with(self, z: Array) -> tuple[Array, Array]:
        jacobian = self._model.jacobian(self.x[: self.states], self.x[self.states :])[:, self.estimated_index]
        jacobian = jacobian * np.isfinite(z)[:, None]
        joint = jacobian @ self._p @ jacobian.T + self._noise
        self.roots.append(np.linalg.cholesky(joint * np.outer(self.volts, self.volts)))
        return super()._correct_with(z)


def whitener(
    device: Device, settings: ObserverSettings, sense: Array, drive: Array, controller: ControllerSettings | None = None
) -> Array:
    """(n, axes, axes): times the innovations of a base model's observer with an EKF, V, they are white and of unit
    variance: the second less what the first says of it.
    """
    observer = _Joint(device, settings, controller)
    observer.run(sense, drive)
    return np.linalg.inv(np.array(observer.roots))
