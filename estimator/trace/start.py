"""How a pass over a record begins, with the motion that the first cycles show; and when its start is over."""

import numpy as np

from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.start


def begin_moving(observer: Observer, record: Record) -> None:
    """Give a new observer of two axes the motion that the first cycles of the record show, where they show one and its
    settings say none.

    Its spread stays as wide as it is.  From rest, a filter takes its first sample for a displacement by the slope that
    its sense equation has there, and is surer of it than any curvature lets it be: a channel with a quadratic part of
    9 % took a sixteenth of a record to come back.
    """
    device, given = observer.device, set(observer.names[: observer.states]) & set(observer.settings.initial)
    if device.axes != 2 or given:
        return
    stiffness = observer.state[[observer.names.index(name) for name in ("kxx", "kyy")]]
    if not np.all(stiffness > 0.0):
        return
    motion = first_motion(record, float(np.sqrt(np.mean(stiffness)))) / device.sense_gain
    if np.all(np.isfinite(motion)):
        observer.begin_moving(motion)


def first_motion(record: Record, omega: float) -> Array:
    """Each channel's fundamental and its slope (2, axes), V and V/s, at the beginning of a record's first interval, by
    least squares beside an offset and the harmonics that a bent channel adds; NaN where too few samples tell.
    """
    cycle = 2.0 * np.pi / omega / float(np.mean(record.step))
    # A harmonic close to half the sampling rate has its cosine or its sine alone; twice as many samples as unknowns.
    most = THRESHOLDS.spectrum.orders
    orders = [order for order in range(1, 1 + most) if order == 1 or 2.5 * order < cycle]
    rows = slice(0, int(np.ceil(max(_SET.cycles * cycle, 2.0 * (1 + 2 * len(orders))))))
    phase, sense = omega * np.cumsum(record.step[rows]), record.sense[rows]
    waves = [wave(order * phase) for order in orders for wave in (np.cos, np.sin)]
    design = np.column_stack([np.ones(len(phase)), *waves])
    told = np.all(np.isfinite(sense), axis=1)
    if np.sum(told) <= design.shape[1]:
        return np.full((2, sense.shape[1]), np.nan)
    found = np.linalg.lstsq(design[told], sense[told], rcond=None)[0]
    return np.asarray(found[1:3] * np.array([[1.0], [omega]]))


def settled_from(settings: ObserverSettings, device: Device, samples: int) -> int:
    """First of so many samples that is scored: behind the start, but not beyond a share of a short record."""
    return min(settling(settings, device), samples // _SET.most)


def settling(settings: ObserverSettings, device: Device) -> int:
    """Samples after which a start from the declared values is over."""
    return int(_SET.memories * min(settings.memory, _SET.longest_memory) * device.sample_rate)
