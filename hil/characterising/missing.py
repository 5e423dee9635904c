"""Why records do not tell a figure of a data sheet, and how long one is that would."""

import math

from estimator.characteristics.response import LEAST
from estimator.characteristics.scale_factor import LEAST_TURNS, Line, fewest, passed
from estimator.characteristics.start_up import FEWEST
from estimator.characteristics.stretches import HARMONICS, Stretches
from hil.characterising.source import Axis

_CONFOUNDED = "the record does not separate it from the figures above"
_LEVEL = 3  # stretches at a rate, of which there is a mean


def lasting(seconds: float) -> str:
    """A length of time as a record would be ordered.

    >>> lasting(0.44), lasting(75.0), lasting(700.0), lasting(40_000.0)
    ('0.44 s', '75 s', '12 min', '12 h')
    """
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    minutes = math.ceil(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{math.ceil(minutes / 60.0)} h"


def why_missing(found: Line | None, whole: Stretches, record: Axis, stretch_s: float) -> dict[str, str]:
    """By figure.  found: the fit, if there is one; whole: stretches of all records, `stretch_s` long; record: the
    longest.
    """
    why: dict[str, str] = {}
    shortest = _long(fewest(whole), record, stretch_s)
    why["bias"], why["bias_turn_on"] = f"needs {shortest}", f"needs two records of {shortest}"
    unmoved = (
        "needs a reference that moves" if whole.reference is not None else "needs a reference: how the device rotated"
    )
    moved = ("scale_factor_error", "scale_factor_nonlinearity", "scale_factor_asymmetry", "bandwidth", "delay")
    why |= dict.fromkeys((*moved, "threshold", "dead_zone", "scale_factor_temperature"), unmoved)
    if whole.moves:
        why |= {
            "scale_factor_nonlinearity": f"needs three rates, each applied for {_long(_LEVEL, record, stretch_s)}",
            "scale_factor_asymmetry": "needs rates of both signs, and of several sizes",
            "bandwidth": "the output does not fall by 3 dB where it follows the reference",
            "delay": "no frequency at which the output follows the reference",
            "threshold": "no rate below 5 % of the largest lasted long enough to exceed the noise",
            "dead_zone": "no rate below 5 % of the largest lasted long enough to exceed the noise",
        }
        if record.span < LEAST:
            why |= dict.fromkeys(("bandwidth", "delay"), f"needs {lasting(LEAST / record.rate_Hz)}")
    cold = "needs a temperature" if whole.temperature is None else "needs a temperature that changes by 2 K"
    why["bias_temperature"] = cold
    if whole.moves:
        why["scale_factor_temperature"] = cold
    if whole.pattern is not None:
        share = passed(whole)
        longer = (
            lasting(len(whole) * stretch_s * LEAST_TURNS / share) if share > 1.0 / 16.0 else "a pattern that rotates"
        )
        every = f"the pattern passed {100.0 * share:.0f} % of half a rotation; needs about {longer}"
        why |= {f"{kind}_{k}theta": every for kind in ("bias", "scale_factor") for k in HARMONICS}
        if not whole.moves:
            why |= {f"scale_factor_{k}theta": unmoved for k in HARMONICS}
    why["start_up"] = f"needs {_long(FEWEST, record, stretch_s)}"
    return why if found is None else why | dict.fromkeys(found.confounded, _CONFOUNDED)


def _long(stretches: int, record: Axis, stretch_s: float) -> str:
    """So many stretches, behind what does not count of the record."""
    if record.steady:
        return f"{stretches} rows"
    before_s = max(record.settled_from - record.first, 0) / record.rate_Hz
    return lasting(before_s + stretches * stretch_s)
