"""Steps of the target stiffness: an experiment that tells the drive chain's effects from the device's parameters."""

from estimator.observer import Observer
from hil.bench import Bench


class TargetSteps:
    """Moves the controller's target stiffness up and down while the loop runs, as the bench file says."""

    def __init__(self, observer: Observer, bench: Bench) -> None:
        controller = bench.controller
        self._observer = observer
        self._size = controller.stiffness_step
        self._half = max(round(0.5 * bench.device.sample_rate_Hz / controller.stiffness_step_Hz), 1)
        self._next = 0 if self._size else None

    @property
    def due(self) -> int | None:
        """Sample of the run at which the next step is due, None for none."""
        return self._next

    def __call__(self, since: int) -> None:
        """See to the target at sample `since` of the run."""
        if self._next is None or since < self._next:
            return
        up = since // self._half % 2 == 0
        self._observer.scale_target(1.0 + self._size if up else 1.0 - self._size)
        self._next = (since // self._half + 1) * self._half
