"""The Cramér–Rao bound of a recorded run, beside what the observer made of it."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from hil.bench import Bench
from hil.records.runfolder import RunFolder
from hil.records.truth import Truth
from hil.running.recording.tracks import column_of
from hil.sweeping.tasks import Row

Floats = npt.NDArray[np.float64]


def least_deviation(folder: RunFolder, truth: Truth, bench: Bench, coefficients: Mapping[str, float]) -> Row:
    """Bounds of rate and pattern angle, rms over the scored window and at its end, as columns of a campaign.

    Along the true trajectory, from the first sample on, with the noise that the bench declares; `coefficients` are
    the true ones of the effects that it declares.

    A virtual rotation that reverses is taken as if it did not: its sign changes the bound of the angle by the ratio of
    rotation to resonance.  None of them where the record lacks samples or the truth does not have the whole state.
    """
    from estimator.bound import posterior_bound
    from estimator.observer import Observer
    from hil.inputs.declared import observer_settings_of, recorded_device_of

    capture, estimates = folder.capture, folder.estimates
    if capture is None or estimates is None or not len(estimates):
        return {}
    tick = capture.tick
    known, _ = truth.at(tick)
    device, settings = recorded_device_of(bench, capture), observer_settings_of(bench)
    observer = Observer(device, settings)
    base = len(observer.model.names)
    names = [column_of(name) for name in observer.names[:base]]
    own = observer.names[base:]
    if len(known) != len(tick) or np.any(np.diff(tick) != 1) or "rate_rad_s" not in names:
        return {}
    if not all(name in truth.constants or name in truth.columns for name in names) or set(own) - set(coefficients):
        return {}
    there = truth.between(int(tick[0]), int(tick[-1]))
    constants = {**truth.constants, **{name: coefficients[name] for name in own}}
    true = np.stack(
        [np.full(len(tick), constants[n]) if n in constants else np.asarray(there[n]) for n in (*names, *own)], 1
    )
    every = bench.loop.estimate_every
    bound = posterior_bound(
        device,
        settings,
        true,
        capture.drive,
        every=every,
        virtual_rotation=bench.controller.virtual_rotation_rad_s,
    )
    scored = tick[bound.index] / estimates.tick_rate_Hz >= folder.scored_from_s
    if not scored.any():
        return {}
    rate, pattern = bound.of("rate")[scored], bound.angle[scored]
    return {
        "bound_rate_rms_rad_s": _rms(rate),
        "bound_rate_end_rad_s": float(rate[-1]),
        "bound_pattern_rms_rad": _rms(pattern),
        "bound_pattern_end_rad": float(pattern[-1]),
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
