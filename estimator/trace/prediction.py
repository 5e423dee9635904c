"""Free runs: how far a model gets by itself, cycle after cycle, where an innovation judges it over one sample only.

The bench's observer follows the record, is left without measurement for some cycles, follows again, and so on.  Forces,
delays, memories of effects and the rate as last estimated all stay in play, as in the loop when samples are lost.
"""

from dataclasses import replace

import numpy as np

from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Gain
from estimator.trace.observed import run
from estimator.trace.problem import Problem
from estimator.trace.start import settled_from

READ = 100_000
"""Samples on either side of the split that are run freely, and over which the angle is read: more costs minutes."""
FREE_CYCLES, FOLLOWED = 20, 3
"""So long the bench is at most without samples before it stops; and times that, after which it has recovered."""
UNSEEN = 1e12
"""Times the variance of the noise: such a measurement changes nothing."""


def free_run_error(problem: Problem, split: int) -> Array:
    """What free runs were off by at their samples, (n, axes) V; NaN where the record was followed.

    Of a long record, in as many samples before `split` and behind it as the angle is read on.
    """
    record, device, settings = problem.record, problem.device, problem.settings
    errors = np.full((len(record), device.axes), np.nan)
    first, last = max(split - READ, 0), min(split + READ, len(record))
    cycle = 2.0 * np.pi / np.sqrt(device.target) / float(np.mean(record.step))
    free = round(FREE_CYCLES * cycle)
    fading = Gain.FADING if settings.gain is Gain.STATIONARY else settings.gain
    observer = Observer(device, replace(settings, gain=fading), problem.controller)
    observer.hold_coefficients()
    # What coefficients count from is the record's own beginning: its time, its first temperature.
    temperature = record.channels.get("temperature")
    warmth = None if temperature is None or not len(temperature) else float(temperature[0])
    observer.begin_at(float(np.sum(record.step[:first])), warmth)
    begin = first + max(settled_from(settings, device, last - first), 1)
    run(observer, record.part(slice(first, begin)))
    while begin + free <= last:
        rows = slice(begin, begin + free)
        with observer.noisier(UNSEEN):
            part = record.part(rows)
            errors[rows] = run(observer, part).innovation
            errors[rows][part.stretches[0].stop :] = np.nan  # behind a gap nothing is known of the motion
        begin = rows.stop + FOLLOWED * free
        if begin + free <= last:
            run(observer, record.part(slice(rows.stop, begin)))
    return errors
