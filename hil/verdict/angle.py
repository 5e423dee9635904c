"""Whether the reported angle is worth what the bench file asks of it."""

import numpy as np

from hil.bench import Bench
from hil.inputs.formula import formula_of
from hil.numbers import percent, quantity
from hil.records.estimates import Estimates
from hil.records.result import Part, Result
from hil.records.runfolder import RunFolder
from hil.verdict.budget import largest_source
from hil.verdict.remedies import remedy

_OPEN_LOOP = (
    "no angle to judge: {why}; run with the control law on for one, or with "
    '[observer] variant = "sense", which integrates the rate'
)
_BEYOND = 2.0
"""Expanded uncertainties, four standard ones: an honest angle is off by more in one run of 16 000."""
_UNTOLD = "the observer gives no uncertainty of its angle (angle_u); hil score with a truth shows its error"
_FROM_ELSEWHERE = "no angle to judge: an imported record without control is judged by its model"


def judge_angle(folder: RunFolder, result: Result, bench: Bench) -> Part:
    """Share of the scored window at which energy and quadrature were outside their limits, and the expanded uncertainty
    at its end.

    A run that was asked for no angle is not judged by it. One of whose angle nobody knows what it is worth has failed
    in that part; so has one whose angle is off by more than it says, where the truth was told.
    """
    estimates, limits = folder.estimates, bench.limits
    if estimates is None or "energy_ratio" not in estimates:
        return Part(outcome="unknown")
    if estimates.header.get("angle") == "none":
        ran = folder.capture is None or folder.capture.header.get("identity") is not None
        return Part(outcome="unknown", reason=_OPEN_LOOP.format(why=formula_of(bench).why) if ran else _FROM_ELSEWHERE)
    scored = estimates.settled(bench.loop.settle_s)
    if not len(scored):
        return Part(outcome="unknown")
    reasons, after = [], None
    if estimates.header.get("angle") != "rate":  # the integrated rate needs no slender ellipse
        outside = np.zeros(3)
        for piece in scored.pieces():
            held = np.abs(piece["energy_ratio"] - 1.0) <= limits.energy_error  # NaN is not held either
            held |= not bench.controller.enabled and np.isfinite(piece["energy_ratio"])  # nothing is to hold it
            slender = np.abs(piece["quadrature_ratio"]) <= limits.quadrature
            outside += [np.count_nonzero(~mask) for mask in (held & slender, held, slender)]
        invalid, off, oval = (float(share) for share in outside / len(scored))
        if invalid > limits.invalid_fraction:
            reasons.append(
                f"the angle was not valid {percent(invalid, 2)} of the time (energy off target {percent(off, 2)}, "
                f"quadrature too large {percent(oval, 2)}), [limits] invalid_fraction is "
                f"{percent(limits.invalid_fraction, 2)}"
            )
    expanded = result.angle_expanded_rad
    error = None if result.score is None else result.score.angle_error_end_rad
    if expanded is not None and error is not None and error > _BEYOND * expanded:
        reasons.append(
            f"the truth contradicts the angle: at the end it is off by {_angle(error)}, "
            f"and uncertain by {_angle(expanded)} (k = 2)"
        )
    if expanded is not None and expanded > limits.angle_rad:
        largest = result.uncertainty[0]
        reasons.append(
            f"the angle is uncertain by {_angle(expanded)} (k = 2), [limits] angle_rad is {limits.angle_rad:g}; "
            f"largest source: {largest_source(largest)}"
        )
        after = remedy(largest, bench).text
    if not reasons and expanded is None and _untold(scored):
        return _by_truth(error, limits.angle_rad)
    if not reasons and expanded is None:
        return Part(outcome="failed", reason="the angle's uncertainty is not finite: the observer diverged")
    part = Part.of(reasons)
    if not reasons:
        assert expanded is not None
        return part.model_copy(update={"reason": f"uncertain by {_angle(expanded)} (k = 2) at the end"})
    return part.model_copy(update={"next": after})


def _untold(scored: Estimates) -> bool:
    """Whether the observer is one that tells no uncertainty of its angle, which it has."""
    if "observer" not in scored.header.get("plugins", {}):
        return False
    return all(
        bool(np.isfinite(piece["angle_rad"]).all() and np.isnan(piece["angle_sd_rad"]).all())
        for piece in scored.pieces()
    )


def _by_truth(error_rad: float | None, limit_rad: float) -> Part:
    """What an angle without an uncertainty is worth: nobody knows, unless the truth was told."""
    if error_rad is None:
        return Part(outcome="unknown", reason=_UNTOLD)
    told = f"off by {_angle(error_rad)} at the end, by the truth; the observer gives no uncertainty of it"
    if error_rad > limit_rad:
        return Part.of([f"the angle is {told}, [limits] angle_rad is {limit_rad:g}"])
    return Part.of([]).model_copy(update={"reason": told})


def _angle(size_rad: float) -> str:
    return quantity(size_rad, "rad", 2)
