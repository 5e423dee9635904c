"""Errors of a part held out, before and after, over one noise floor."""

from dataclasses import replace

import numpy as np

from estimator.diagnosis import Fit
from estimator.trace.promises import Errors


def residual_of(before: Fit, after: Fit, samples: float) -> Errors:
    """Innovations of the part held out in multiples of the floor (`on_one_floor`)."""
    was, left = on_one_floor(before, after)
    return Errors(was.ratio, left.ratio, 1.0, samples)


def on_one_floor(before: Fit, after: Fit) -> tuple[Fit, Fit]:
    """Both over the same floor, per axis the lower of the two that were seen: a model that raises all of the spectrum
    does not raise its own measure, and what an effect had put into the floor counts as a part of the residual.
    """
    floor = np.minimum(before.noise_floor, after.noise_floor)
    source = before.floor_from
    if after.floor_from != source:
        source = f"the lower of {source} and {after.floor_from}"

    def over(fit: Fit) -> Fit:
        multiples = np.array(fit.innovation_rms) / np.maximum(floor, np.finfo(float).tiny)
        ratio = float(np.sqrt(np.mean(multiples**2)))
        return replace(fit, noise_floor=tuple(floor.tolist()), ratio=ratio, floor_from=source)

    return over(before), over(after)
