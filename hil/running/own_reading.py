"""What the bench's own observer reads of a run that a plug-in observed: nobody else knows what its angle is worth.

A plug-in may have its angle and its rate from one wrong number, and its innovations right all the same.
"""

import numpy as np

from estimator.gaps import observe
from estimator.observer import Observer
from hil.bench import Bench, override
from hil.inputs.captured import control_of, drives_of, gaps_of, pieces_of_samples
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.numbers import COVERAGE
from hil.records.result import OwnReading
from hil.records.runfolder import RunFolder


@np.errstate(all="ignore")  # an observer that diverged has nothing to say
def own_reading(folder: RunFolder, bench: Bench) -> OwnReading | None:
    """Where, in the scored window, the plug-in's angle is farthest from that of the bench's observer; None of a run
    without a plug-in, without an angle, or of which the bench's observer has none.
    """
    capture, estimates = folder.capture, folder.estimates
    if bench.observer.plugin is None or capture is None or estimates is None or capture.carrier_Hz is not None:
        return None
    if bench.device.axes != 2 or folder.trims is not None or estimates.header.get("angle") != "pattern":
        return None
    scored = estimates.settled(bench.loop.settle_s)
    if len(scored) < 2:
        return None
    own = override(bench, {"observer": {"plugin": None}}, bench.loop.name)
    device = recorded_device_of(own, capture)
    observer = Observer(device, observer_settings_of(own), control_of(own, capture))
    drives, every = drives_of(capture, device), bench.loop.estimate_every
    ticks, own_angle, own_sd = scored.tick, [], []
    for samples in pieces_of_samples(capture, drives):
        seen = observe(observer, samples.sense, samples.drive, gaps_of(samples, drives), step=samples.step, every=every)
        # Of each piece what the estimates have rows of: a run of hours has no room for all.
        begin, end = np.searchsorted(ticks, samples.tick[[0, -1]] + [0, 1])
        rows = np.searchsorted(samples.tick, ticks[begin:end])
        own_angle.append(seen.angle[rows])
        own_sd.append(seen.angle_deviation[rows])
    own_read = np.concatenate(own_angle)
    if not len(own_read):
        return None
    read = np.stack([np.concatenate([piece["angle_rad"] for piece in scored.pieces()])[: len(own_read)], own_read])
    turned = read - read[:, :1]
    at = int(np.argmax(np.abs(turned[0] - turned[1])))
    sd = float(np.concatenate(own_sd)[at])
    if not np.isfinite([*turned[:, at], sd]).all():
        return None
    return OwnReading(plugin_rad=float(turned[0, at]), own_rad=float(turned[1, at]), own_expanded_rad=COVERAGE * sd)
