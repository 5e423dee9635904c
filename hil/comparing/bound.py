"""The posterior Cramér–Rao bound of a record whose truth is known."""

from dataclasses import replace

import numpy as np

from estimator.model.catalogue import model_for
from estimator.rotation_bound import rotation_bound
from estimator.scaling import Array
from estimator.settings import Variant
from hil.comparing.course import DAMPING, STIFFNESS
from hil.comparing.record import Given
from hil.errors import InputError
from hil.records.methods import MethodRow
from hil.records.truth import Truth

BOUND = "posterior Cramér–Rao bound"
_MOTION = ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s")


def bound_of(given: Given, truth: Truth) -> MethodRow:
    """Least deviations, rms over the scored window, of 13 states under what the bench file declares of noise, random
    walk and initial value; the angle's is that of its change since the start of the window.

    Raises InputError where the truth lacks a sample of the record.
    """
    device, settings = given.device, replace(given.settings, variant=Variant.FULL, effects={})
    every = given.bench.loop.estimate_every
    rotation, deviation = rotation_bound(
        device, settings, _states(given, truth), every=every, lost=np.isnan(given.sense)
    )
    tick = given.samples.tick[every - 1 :: every]
    scored = tick / device.sample_rate >= given.scored_from_s
    names = model_for(2)[1].names

    def end(wanted: tuple[str, ...]) -> float:
        return _rms(deviation[-1, [names.index(name) for name in wanted]])

    constants = truth.constants
    return MethodRow(
        name=BOUND,
        kind="bound",
        record="this",
        angle_error_rms_rad=_rms(rotation[scored]),
        angle_error_max_rad=float(np.max(rotation[scored])),
        rate_error_rms_rad_s=_rms(deviation[scored, names.index("rate")]),
        stiffness_error=end(STIFFNESS) / device.target,
        damping_error=end(DAMPING) / (0.5 * (constants["dxx_per_s"] + constants["dyy_per_s"])),
        remark="under the declared noise and random walk of the rate",
    )


def _states(given: Given, truth: Truth) -> Array:
    """True state vector at every sample (n, 13)."""
    tick = given.samples.tick
    ours, theirs = truth.at(tick)
    if len(ours) != len(tick):
        raise InputError("the truth lacks samples of the record, so there is no bound; give the truth of this run")
    motion = np.column_stack([truth[name][theirs] for name in _MOTION])
    constants = truth.constants
    named = [f"{name}_per_s2" for name in STIFFNESS] + [f"{name}_per_s" for name in DAMPING]
    each = [np.full(len(tick), constants[n]) if n in constants else truth[n][theirs] for n in named]
    return np.column_stack([motion, *each])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
