"""Free runs: how far a model gets by itself, cycle after cycle, where an innovation judges it over one sample only.

The bench's observer follows the record, is left without measurement for some cycles, follows again, and so on.  Forces,
delays, memories of effects and the rate as last estimated all stay in play, as in the loop when samples are lost.
"""

from dataclasses import replace

import numpy as np

from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Gain
from estimator.trace.fitting import run
from estimator.trace.problem import Problem
from estimator.trace.start import hold, settling
from estimator.trace.thresholds import THRESHOLDS

_SET = THRESHOLDS.scoring


def free_run_error(problem: Problem) -> Array:
    """What free runs were off by at their samples, (n, axes) V; NaN where the record was followed."""
    record, device, settings = problem.record, problem.device, problem.settings
    cycle = 2.0 * np.pi / np.sqrt(device.target) / float(np.mean(record.step))
    free = round(_SET.free_cycles * cycle)
    fading = Gain.FADING if settings.gain is Gain.STATIONARY else settings.gain
    observer = Observer(device, replace(settings, gain=fading), problem.controller)
    hold(observer)
    seen = observer.record["noise"].copy()
    errors = np.full((len(record), device.axes), np.nan)
    begin = max(min(settling(settings, device), len(record) // _SET.settled), 1)
    run(observer, record.part(slice(0, begin)))
    while begin + free <= len(record):
        rows = slice(begin, begin + free)
        observer.record["noise"] = seen * _SET.unseen
        errors[rows] = run(observer, record.part(rows)).innovation
        observer.record["noise"] = seen
        begin = rows.stop + _SET.followed * free
        if begin + free <= len(record):
            run(observer, record.part(slice(rows.stop, begin)))
    return errors
