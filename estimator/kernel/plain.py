"""The observer of 13 states without effects, its covariances in vector registers: what streams.

It is the step without effects of `estimator.kernel.generate.step`; which observers it is for is decided here.
"""

from estimator.kernel.compiled import compiled
from estimator.kernel.layout import Floats, Ints, Record
from estimator.kernel.steps import base_step

STEP = base_step()
STATES: int = STEP.STATES
CONSTANTS: int = STEP.CONSTANTS
SIZE: int = STEP.SIZE


@compiled
def is_plain(settings: Record, active: Ints, x: Floats) -> bool:
    """Whether these kernels do what the settings ask for."""
    fading: bool = settings.two_covariances == 1 and settings.stationary == 0 and settings.general == 0
    bare: bool = settings.effect_count == 0 and settings.signal_count == 0 and x.shape[0] == SIZE
    two_axes: bool = settings.axes == 2 and active.shape[0] == CONSTANTS
    return fading and bare and two_axes
