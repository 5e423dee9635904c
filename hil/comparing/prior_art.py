"""What the source calls prior art, on a record that is there already: (a), (b), (c) and (e).  (d) closes the loop
itself: `hil.comparing.own_loop`."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from estimator.prior_art import friedland_hutton, integrated_rate, raw_pattern
from estimator.prior_art.reading import Reading
from hil.comparing.course import MethodCourse
from hil.comparing.observers import course_of, integrated, with_observer
from hil.comparing.record import Given

RATE_WITHOUT_OFFSETS = "(a) rate without sense errors, integrated"
RATE_IDENTIFIED = "(a) rate by modulating functions, integrated"
RAW = "(b) formula (11) on raw signals"
RAW_AVERAGED = "(b) formula (11), averaged over a cycle"
WITHOUT_OFFSETS = "(c) control law without sense errors"
OF_STREAMS = "(b) formula (11) on the components"
ELEMENTS = "(e) Friedland–Hutton"


def methods(given: Given) -> Iterator[tuple[str, Callable[[], MethodCourse]]]:
    """Names, and what runs each."""
    device, control, samples = given.device, given.control, given.samples
    gain = given.bench.observer.gain
    eleven = with_observer(given.bench, "gyro", gain)
    yield RATE_WITHOUT_OFFSETS, lambda: integrated(given, eleven, RATE_WITHOUT_OFFSETS)
    yield (
        RATE_IDENTIFIED,
        lambda: read(
            given, RATE_IDENTIFIED, lambda: integrated_rate.read(given.sense, samples.drive, device, given.settings)
        ),
    )
    yield RAW, lambda: read(given, RAW, lambda: raw_pattern.read(given.sense, device, control))
    yield (
        RAW_AVERAGED,
        lambda: read(given, RAW_AVERAGED, lambda: raw_pattern.read(given.sense, device, control, cycles=1)),
    )
    yield WITHOUT_OFFSETS, lambda: course_of(given, eleven, WITHOUT_OFFSETS, "prior art")
    yield ELEMENTS, lambda: read(given, ELEMENTS, lambda: friedland_hutton.read(given.sense, device, control))


def of_streams(given: Given) -> tuple[str, Callable[[], MethodCourse]]:
    """Of demodulated streams."""
    device, control = given.device, given.control
    return OF_STREAMS, lambda: read(
        given, OF_STREAMS, lambda: raw_pattern.read_components(given.sense, device, control)
    )  # fmt: skip


def read(given: Given, name: str, method: Callable[[], Reading]) -> MethodCourse:
    """A method of `estimator.prior_art` on the record, at the rows at which the observers are read."""
    begun = time.process_time()
    reading = method()
    cost_us = 1e6 * (time.process_time() - begun) / len(given.samples.tick)
    return replace(as_course(reading, name, given), cost_us=cost_us)


def as_course(reading: Reading, name: str, given: Given) -> MethodCourse:
    """A reading in bench time; of one at every sample, one in `estimate_every`."""
    dense = len(reading.index) > len(given.samples.tick) // 2
    keep = slice(None, None, given.bench.loop.estimate_every if dense else 1)
    return MethodCourse(
        name=name,
        kind="prior art",
        tick=given.samples.tick[reading.index[keep]],
        angle=reading.angle[keep],
        rate=None if reading.rate is None else reading.rate[keep],
        parameters={label: float(values[-1]) for label, values in reading.parameters.items()},
    )
