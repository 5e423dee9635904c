"""Whether the reported angle is worth what the bench file asks of it."""

import numpy as np

from hil.bench import Bench
from hil.records.result import Part
from hil.records.runfolder import RunFolder


def judge_angle(folder: RunFolder, bench: Bench) -> Part:
    """Share of the scored window at which energy and quadrature were outside their limits."""
    estimates, limits = folder.estimates, bench.limits
    if estimates is None or "energy_ratio" not in estimates or not bench.controller.enabled:
        return Part(outcome="unknown")
    scored = estimates.t_s >= bench.loop.settle_s
    if not scored.any():
        return Part(outcome="unknown")
    held = np.abs(estimates["energy_ratio"][scored] - 1.0) <= limits.energy_error  # NaN is not held either
    slender = np.abs(estimates["quadrature_ratio"][scored]) <= limits.quadrature
    invalid = 1.0 - float(np.mean(held & slender))
    if invalid <= limits.invalid_fraction:
        return Part(outcome="good")
    off, oval = 1.0 - float(held.mean()), 1.0 - float(slender.mean())
    return Part.of(
        [
            f"the angle was not valid {invalid:.2%} of the time (energy off target {off:.2%}, quadrature too large "
            f"{oval:.2%}), [limits] invalid_fraction is {limits.invalid_fraction:.2%}"
        ]
    )
