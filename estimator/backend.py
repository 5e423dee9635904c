"""Which arithmetic runs the declared model: the compiled core, or one of the two oracles."""

from typing import Literal, get_args

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, ObserverSettings

Backend = Literal["c", "numpy", "filterpy"]


def make_observer(
    backend: Backend, device: Device, settings: ObserverSettings, controller: ControllerSettings | None = None
) -> Observer:
    """An observer of that backend; `numpy` and `filterpy` replay records and have no `tick`.

    Raises ModelError for an unknown backend, and what the observer itself raises.
    """
    if backend == "c":
        return Observer(device, settings, controller)
    if backend == "numpy":
        from estimator.oracle.numpy_observer import NumpyObserver

        return NumpyObserver(device, settings, controller)
    if backend == "filterpy":
        from estimator.oracle.filterpy_observer import FilterpyObserver

        return FilterpyObserver(device, settings, controller)
    raise ModelError(f"no backend {backend!r}; known: {', '.join(get_args(Backend))}")
