"""The bench's observers on a record: three by what they estimate, each with three gains.

What the patent calls prior art, on a record that is there already: (a), (b), (c) and (e).  (d) closes the loop
itself: `hil.comparing.own_loop`.

The methods of others are plug-ins like any other, in `examples/prior-art`.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.gaps import Gaps, observe
from estimator.observer import Estimates, Observer
from estimator.rotation import Rotation
from estimator.scaling import Array
from hil.bench import Bench, override
from hil.bench.examples import directory
from hil.comparing.course import DAMPING, STIFFNESS, Given, MethodCourse
from hil.inputs.captured import gaps_of
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.plugins.of_bench import recorded_observer
from hil.records.methods import MethodKind
from hil.toml.reading import parse_table
from hil.verdict.budget import combined, contributions
from hil.verdict.uncertainty import Sources

STATES = {"sense": 7, "gyro": 11, "full": 13}
GAINS = ("stationary", "ekf", "fading")
_LEVEL_SAMPLES = 200
"""Over which the innovation is averaged before it tells of a divergence, as in a run."""


class Observed(NamedTuple):
    """Rows of the estimates: the samples `at` (rows,) that they follow, what was estimated, and the sample at which the
    innovation left its bounds, None where it did not.
    """

    names: tuple[str, ...]
    at: NDArray[np.int64]
    state: Array
    deviation: Array
    angle: Array
    angle_sd: Array
    forced: Array
    rate_integral: Array
    lost: int | None


def name_of(variant: str, gain: str) -> str:
    return f"{STATES[variant]} states, {gain if gain != 'ekf' else 'EKF'}"


def with_observer(bench: Bench, variant: str, gain: str) -> Bench:
    """The bench with another of its own observers."""
    chosen = {"variant": variant, "gain": gain, "plugin": None}
    return override(bench, {"observer": chosen}, bench.device.name or "bench")


def plugin_name(plugin: str) -> str:
    """What the row of an observer plug-in is called."""
    return f"plug-in {plugin.rpartition('/')[2]}"


def rotation_name() -> str:
    """What the row is called whose angle is a state of its own."""
    return f"{STATES['full']} states and the rotation, EKF"


def without_effects(bench: Bench) -> Bench:
    return parse_table({**bench.model_dump(), "effects": {}}, Bench, bench.device.name or "bench")


def course_of(
    given: Given, bench: Bench, name: str, kind: MethodKind = "observer", *, rotation: bool = False
) -> MethodCourse:
    """The observer of `bench` over the record; with `rotation`, the angle is that of a state of its own.  Raises
    ModelError where there is no such observer.
    """
    device, settings = recorded_device_of(bench, given.captured), observer_settings_of(bench)
    plugin = bench.observer.plugin is not None
    observer = recorded_observer(bench, given.captured) if plugin else Observer(device, settings, given.control)
    beside = Rotation(observer) if rotation else None
    begun = time.process_time()
    seen = observed(given, observer, bench, beside)
    cost_us = 1e6 * (time.process_time() - begun) / len(given.samples.tick)
    tick = given.samples.tick[seen.at]
    column = {label: i for i, label in enumerate(seen.names)}
    # What a plug-in leaves out is declared, with a deviation of zero.
    estimated = {label for label in observer.estimated if seen.deviation[-1, column[label]] != 0.0}
    parameters = [label for label in (*STIFFNESS, *DAMPING) if label in estimated]
    rate = column["rate"]
    return MethodCourse(
        name=name,
        kind=kind,
        tick=tick,
        angle=seen.angle,
        rate=seen.state[:, rate],
        rate_sd=seen.deviation[:, rate],
        parameters={label: float(seen.state[-1, column[label]]) for label in parameters},
        deviations={label: float(seen.deviation[-1, column[label]]) for label in parameters},
        angle_u=_angle_u(given, bench, seen, tick / device.sample_rate),
        lost_tick=None if seen.lost is None else int(given.samples.tick[seen.lost]),
        cost_us=cost_us,
    )


def _angle_u(given: Given, bench: Bench, seen: Observed, t_s: Array) -> float | None:
    """Standard uncertainty of the angle over the scored window, by the budget of a run."""
    scored = np.flatnonzero(t_s >= given.scored_from_s)
    if len(scored) < 2 or not np.isfinite(seen.angle_sd[-1]):
        return None
    first, column = int(scored[0]), {label: i for i, label in enumerate(seen.names)}
    sources, state = Sources(bench), seen.state[-1]
    course = sources.course(
        float(t_s[-1] - t_s[first]),
        float(seen.angle[-1] - seen.angle[first]),
        float(seen.forced[-1] - seen.forced[first]),
        float(state[column["kxy"]]),
        tuple(float(state[column[label]]) for label in DAMPING),
    )
    information, scan = given.closing_scan
    return combined(contributions(bench, sources, float(seen.angle_sd[-1]), course, information, scan))


def integrated(given: Given, bench: Bench, name: str) -> MethodCourse:
    """∫Ω̂ dt of the observer of `bench`, as a method of the prior art."""
    device, settings = recorded_device_of(bench, given.captured), observer_settings_of(bench)
    begun = time.process_time()
    seen = observed(given, Observer(device, settings, given.control), bench)
    cost_us = 1e6 * (time.process_time() - begun) / len(given.samples.tick)
    rate = seen.names.index("rate")
    return MethodCourse(
        name, "prior art", given.samples.tick[seen.at], seen.rate_integral, seen.state[:, rate],
        lost_tick=None if seen.lost is None else int(given.samples.tick[seen.lost]), cost_us=cost_us,
    )  # fmt: skip


def observed(given: Given, observer: Observer, bench: Bench, rotation: Rotation | None = None) -> Observed:
    """One pass of an observer, in portions, with what belongs to the rows of the estimates kept; the angle and its
    deviation are those of `rotation` where there is one.
    """
    every = bench.loop.estimate_every
    portion = max((1 << 14) // every, 1) * every
    samples, parts, level = given.samples, [], _Level(observer, bench)
    for first in range(0, len(samples.tick), portion):
        piece = samples.part(slice(first, first + portion))
        gaps: Gaps | None = gaps_of(piece, given.drives)
        with np.errstate(all="ignore"):  # an observer that diverged is told by its figures, not by NumPy
            estimates = observe(
                observer, piece.sense, piece.drive, gaps, step=piece.step, every=every if rotation is None else 1
            )
            angle, deviation = (
                (estimates.angle, estimates.angle_deviation)
                if rotation is None
                else rotation.follow(estimates, piece.sense)
            )
        level.saw(estimates)
        row = slice(None) if rotation is None else slice(every - 1, None, every)
        at = estimates.index[row]
        parts.append(
            (at + first, estimates.state[row], estimates.deviation[row], angle[at], deviation[at],
             estimates.angle_forced[at], estimates.angle_rate_integral[at])
        )  # fmt: skip
    index, state, deviation, angle, angle_sd, forced, integral = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    return Observed(observer.names, index, state, deviation, angle, angle_sd, forced, integral, level.lost)


class _Level:
    """Watches the innovation; `lost` is the sample at which its mean square over the last ones left [limits]
    residual_safe, as a run would have stopped, counted from the end of the acquisition.
    """

    def __init__(self, observer: Observer, bench: Bench) -> None:
        self.lost: int | None = None
        self._noise = np.array(observer.device.noise)
        self._limit = bench.limits.residual_safe**2
        self._guarded = int(bench.observer.acquisition_s * observer.device.sample_rate) + _LEVEL_SAMPLES
        self._seen = 0

    def saw(self, estimates: Estimates) -> None:
        with np.errstate(all="ignore"):
            square = np.mean((estimates.innovation / self._noise) ** 2, axis=1)
        lost = ~np.isfinite(estimates.angle)
        square = np.where(np.isnan(square) & ~lost, 0.0, square)  # a sample that did not arrive
        count = len(square) // _LEVEL_SAMPLES
        for block in range(count):
            part = slice(block * _LEVEL_SAMPLES, (block + 1) * _LEVEL_SAMPLES)
            sample = self._seen + part.start
            if self.lost is None and sample >= self._guarded and not np.mean(square[part]) <= self._limit:
                self.lost = sample
        self._seen += len(square)


RATE_WITHOUT_OFFSETS = "(a) rate without sense errors, integrated"
RATE_IDENTIFIED = "(a) rate by modulating functions, integrated"
WITHOUT_OFFSETS = "(c) control law without sense errors"
PLUGINS = {
    RATE_IDENTIFIED: "modulated.py:ModulatedRate",
    "(b) formula (11) on raw signals": "pattern.py:RawFormula",
    "(b) formula (11), averaged over a cycle": "pattern.py:AveragedFormula",
    "(e) Friedland–Hutton": "pattern.py:OrbitalElements",
}


def methods(given: Given) -> list[tuple[str, Callable[[], MethodCourse]]]:
    eleven = with_observer(given.bench, "gyro", given.bench.observer.gain)
    found: dict[str, Callable[[], MethodCourse]] = {
        RATE_WITHOUT_OFFSETS: partial(integrated, given, eleven, RATE_WITHOUT_OFFSETS),
        WITHOUT_OFFSETS: partial(course_of, given, eleven, WITHOUT_OFFSETS, "prior art"),
    }
    for name, plugin in PLUGINS.items():
        found[name] = partial(course_of, given, with_plugin(given.bench, plugin), name, "prior art")
    return sorted(found.items())


def with_plugin(bench: Bench, plugin: str, *, controls: bool = False) -> Bench:
    """The bench with a plug-in of `examples/prior-art` as its observer, and as its controller if it controls."""
    named = {"plugin": str(directory() / "prior-art" / plugin)}
    changes = {"observer": named} | ({"controller": named} if controls else {})
    return override(bench, changes, bench.device.name or "bench")
