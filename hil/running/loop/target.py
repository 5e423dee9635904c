"""Steps of the target stiffness: an experiment that tells the drive chain's effects from the device's parameters."""

from estimator.observer import Observer
from hil.bench import Bench


class TargetSteps:
    """Moves the controller's target stiffness up and down while the loop runs, as the bench file says; the next step is
    `due` at that sample of the run, None for none."""

    def __init__(self, observer: Observer, bench: Bench) -> None:
        controller = bench.controller
        self._observer = observer
        self._size = controller.stiffness_step
        self._half = max(round(0.5 * bench.device.sample_rate_Hz / controller.stiffness_step_Hz), 1)
        self.due = 0 if self._size else None

    def __call__(self, since: int) -> None:
        """See to the target at sample `since` of the run."""
        if self.due is None or since < self.due:
            return
        up = since // self._half % 2 == 0
        self._observer.scale_target(1.0 + self._size if up else 1.0 - self._size)
        self.due = (since // self._half + 1) * self._half
