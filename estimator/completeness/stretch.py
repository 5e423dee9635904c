"""The parts of a run that its closing scan looks at."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.trace.start import settling

MOST = 120_000
"""Samples of a run in which the angle is followed."""

WEIGHED = 50_000
"""Samples of them by which effects are judged."""

_PARTS = 3  # of a longer run: its beginning, its middle, its end
_LATER = 4  # thirds of `MOST` that middle and end may have each, where an observer takes so long to settle


@dataclass(frozen=True)
class Stretch:
    """Consecutive samples of a run: record, the time of the first of them [s], and whether the run began with it."""

    record: Record
    begin_s: float
    from_start: bool = True

    @property
    def end_s(self) -> float:
        """Time of its last sample."""
        return self.begin_s + float(np.sum(self.record.step))


def stretches_of(samples: int, settling: int = 0) -> tuple[slice, ...]:
    """Which of so many samples to look at: all, or three stretches over the run that hold `MOST` together, and more
    where an observer that begins with one takes `settling` samples to find the constants.
    """
    third = MOST // _PARTS
    later = min(max(third, settling + third // 2), _LATER * third)
    between = samples - third - 2 * later
    if samples <= MOST or between < 0:
        return (slice(0, samples),)
    middle = third + between // 2
    return slice(0, third), slice(middle, middle + later), slice(samples - later, samples)


def weighed_of(stretches: Sequence[Stretch]) -> list[Record]:
    """The first samples of each stretch, `WEIGHED` together: a start from rest tells what a steady motion hides, the
    drive's gain above all.
    """
    return [stretch.record.part(slice(0, WEIGHED // len(stretches))) for stretch in stretches]


def settled_s(stretch: Stretch, settings: ObserverSettings, device: Device, scored_from_s: float) -> float:
    """From when on (s of the run) an observer that begins with the stretch counts: it has found the motion and the
    constants, or there is no more than a quarter of the stretch left to do so, and the scored window has begun.
    """
    found = stretch.begin_s + settling(settings, device) / device.sample_rate if not stretch.from_start else 0.0
    last = stretch.begin_s + 0.75 * (stretch.end_s - stretch.begin_s)
    return max(min(found, last), scored_from_s)


def joined(times: Sequence[Array], courses: Sequence[Array], begin_s: float, end_s: float) -> tuple[Array, Array]:
    """One course (m, k) over [begin_s, end_s] from those of settled stretches, with its time (m,); zero at its start.

    Between stretches, before the first and behind the last, it goes on with the mean slope of the nearest two or one.
    """
    slopes = [
        (course[-1] - course[0]) / (time[-1] - time[0]) if time[-1] > time[0] else np.zeros(course.shape[1])
        for time, course in zip(times, courses, strict=True)
    ]
    at = [np.array([begin_s])]
    moved = [np.zeros((1, courses[0].shape[1]))]
    for i, (time, course) in enumerate(zip(times, courses, strict=True)):
        slope = slopes[i] if i == 0 else 0.5 * (slopes[i - 1] + slopes[i])
        start = moved[-1][-1] + slope * (time[0] - at[-1][-1])
        at.append(time)
        moved.append(course - course[0] + start)
    if end_s > at[-1][-1]:
        moved.append(moved[-1][-1:] + slopes[-1] * (end_s - at[-1][-1]))
        at.append(np.array([end_s]))
    time, course = np.concatenate(at), np.concatenate(moved)
    kept = np.concatenate([[True], np.diff(time) > 0.0])
    return time[kept], course[kept]
