"""Which formula gives the reported angle of a run, and why: decided from the bench file, before the run."""

import math
from typing import Literal, NamedTuple

from hil.bench import Bench
from hil.bench.classic import PLUGIN
from hil.numbers import percent, quantity

Kind = Literal["pattern", "rate", "none"]


class Formula(NamedTuple):
    """kind: formula (11) on the pattern, the integrated rate, or no angle at all; why: one line."""

    kind: Kind
    why: str


def formula_of(bench: Bench) -> Formula:
    """Formula (11) of the source wherever the pattern turns with the board: under the control law, which makes an ideal
    oscillator of the device, and in open loop where the declared gyro is one by itself.

    Elsewhere the pattern turns by itself.  With the parameters known (the observer of 7 states) the integrated rate is
    an angle all the same; estimated beside it, they take their part of it, and there is none.  A plug-in sees to
    its angle itself.
    """
    if bench.device.axes == 1:
        return Formula("none", "a single axis has no angle")
    if bench.observer.plugin is not None:
        own = "the formula of the loops" if bench.observer.plugin == PLUGIN else "the plug-in's own formula"
        if bench.controller.enabled:
            return Formula("pattern", own)
        return Formula("rate", f"{own}, without control")
    if bench.controller.enabled:
        return Formula(
            "pattern", "formula (11), minus the rotation by drive forces: the control law makes the gyro isotropic"
        )
    if not (flaw := _flaw(bench)):
        return Formula("pattern", "formula (11): the declared gyro is isotropic and undamped, so no control is needed")
    if bench.observer.variant == "sense":
        return Formula("rate", f"the integrated rate, not formula (11): without control {flaw}")
    return Formula("none", f"without control {flaw}")


def _flaw(bench: Bench) -> str:
    """Why the declared gyro is no ideal one, "" where it is: over the run its pattern stays slender and its energy
    where [limits] want them, with no help of a control law.
    """
    (kxx, kyy, kxy), damping = bench.device.stiffness_per_s2, bench.device.damping_per_s
    apart = math.hypot(kxx - kyy, 2.0 * kxy) / (2.0 * math.sqrt(bench.target_stiffness_per_s2))
    seconds, limits = bench.loop.duration_s, bench.limits
    if 0.5 * apart * seconds > limits.quadrature:  # what a line along neither mode has become by then
        return f"its modes, {quantity(apart / (2.0 * math.pi), 'Hz', 2)} apart, rotate the pattern"
    lost = -math.expm1(-max(damping[:2]) * seconds)
    if lost > limits.energy_error:
        return f"its damping, which takes {percent(lost)} of the energy, may rotate the pattern"
    return ""
