"""What a method made of a record, in bench time, and what it is held against."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from estimator.gaps import Drives
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, ObserverSettings
from hil.bench import Bench
from hil.errors import InputError
from hil.inputs.captured import Samples, at_rest, control_of, drives_of, samples_of
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.numbers import COVERAGE, finite
from hil.progress import alarms_only
from hil.records.capture import Capture, trims_beside
from hil.records.methods import MethodKind, MethodRow
from hil.records.result import Scan
from hil.records.runfolder import RunFolder
from hil.records.table import scored_from_s
from hil.records.truth import Truth
from hil.replaying.replay import fitting
from hil.running.closing_scan import scan_of, to_model
from hil.scoring.reference import ReferenceRate, reference_rate

if TYPE_CHECKING:
    from estimator.completeness.information import Information


Floats = npt.NDArray[np.float64]
STIFFNESS, DAMPING = ("kxx", "kyy", "kxy"), ("dxx", "dyy", "dxy")
_SETTLED_RAD = 0.02
_HELD = 0.1  # of the scored window, over which it has to hold


@dataclass(frozen=True)
class MethodCourse:
    """Angle (rows,) [rad] and rate [rad/s] after the ticks `tick` (rows,); parameters at the end, [1/s²] and [1/s],
    with their standard deviations where the method says them; angle_u, the standard uncertainty of the angle's change
    over the scored window, and rate_sd (rows,) likewise.  lost_tick: where the method itself tells that it has lost the
    device.
    """

    name: str
    kind: MethodKind
    tick: npt.NDArray[np.int64]
    angle: Floats
    rate: Floats | None = None
    rate_sd: Floats | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    deviations: Mapping[str, float] = field(default_factory=dict)
    angle_u: float | None = None
    lost_tick: int | None = None
    cost_us: float | None = None
    own_record: bool = False
    remark: str = ""


@dataclass(frozen=True)
class Reference:
    """True rotation (n,) [rad] and rate [rad/s] at the ticks `tick` (n,), ascending; the true parameters, where they
    are known.
    """

    name: Literal["truth", "rate channel", "reference gyro"]
    tick: npt.NDArray[np.int64]
    angle: Floats
    rate: Floats
    parameters: Mapping[str, float] = field(default_factory=dict)

    def at(self, tick: npt.NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Angle and rate at other ticks (rows,), linear between."""
        return np.interp(tick, self.tick, self.angle), np.interp(tick, self.tick, self.rate)


def parameters_of(truth: Truth) -> dict[str, float]:
    """True stiffness [1/s²] and damping [1/s], by the names of the model."""
    return {name.partition("_per_")[0]: value for name, value in truth.constants.items()}


def reference_of(captured: Capture, truth: Truth | None, beside: ReferenceRate | str = "") -> Reference | None:
    """The truth, or else the record's own rate channel, or the gyro beside the run; None where there is none."""
    if truth is not None:
        return Reference("truth", truth.tick, truth["angle_rad"], truth["rate_rad_s"], parameters_of(truth))
    rate = captured.rate_rad_s
    if rate is None and not isinstance(beside, str):
        known = captured.part(*np.searchsorted(captured.t_s, beside.t_s[[0, -1]]).tolist())
        turned, its_rate = beside.turned(known.t_s), np.interp(known.t_s, beside.t_s, beside.rate_rad_s)
        return Reference("reference gyro", known.tick, turned, its_rate)
    if rate is None:
        return None
    steps = np.diff(captured.tick) / captured.tick_rate_Hz
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps)])
    return Reference("rate channel", captured.tick, angle, np.asarray(rate))


class Judge:
    """Turns courses into rows: rate_Hz of the ticks, from_s where the scored window begins, the target stiffness."""

    def __init__(self, rate_Hz: float, from_s: float, stiffness_per_s2: float) -> None:
        self.rate_Hz, self.from_s, self._k = rate_Hz, from_s, stiffness_per_s2

    def error(self, course: MethodCourse, reference: Reference) -> tuple[Floats, Floats]:
        """Bench time (rows,) and error of the angle [rad], zero at the start of the scored window."""
        true, _ = reference.at(course.tick)
        return course.tick / self.rate_Hz, self._from_start(course.tick, course.angle - true)

    def row(self, course: MethodCourse, reference: Reference | None) -> MethodRow:
        seconds = course.tick / self.rate_Hz
        scored = seconds >= self.from_s
        if np.count_nonzero(scored) < 2:
            raise InputError(
                f"{course.name}: nothing after {self.from_s:.6g} s, where [loop] settle_s is over; give a longer record"
            )
        row = MethodRow(
            name=course.name,
            kind=course.kind,
            record="its own" if course.own_record else "this",
            angle_rad=finite(course.angle[scored][-1] - course.angle[scored][0]),
            angle_u_rad=None if course.angle_u is None else finite(course.angle_u),
            angle_expanded_rad=None if course.angle_u is None else finite(COVERAGE * course.angle_u),
            rate_expanded_rad_s=None if course.rate_sd is None else finite(COVERAGE * rms(course.rate_sd[scored])),
            stiffness_expanded=self._deviation(course, STIFFNESS, self._k),
            cost_us=course.cost_us,
            remark=course.remark,
        )
        lost_s = None if course.lost_tick is None else course.lost_tick / self.rate_Hz
        if reference is None:
            return row.model_copy(update={"diverged_s": self._notfinite(course) if lost_s is None else lost_s})
        _, error = self.error(course, reference)
        settled = _last(~(np.abs(error - np.mean(error[scored])) <= _SETTLED_RAD))
        off = _last(~(np.abs(error) > 0.5 * np.pi))
        away = [lost_s, self._notfinite(course)]
        if off < len(error):
            away.append(float(seconds[off]))
        found = [moment for moment in away if moment is not None]
        damping = {name: reference.parameters[name] for name in DAMPING if name in reference.parameters}
        mean = 0.5 * (damping["dxx"] + damping["dyy"]) if damping else None
        return row.model_copy(
            update={
                "angle_error_rms_rad": finite(rms(error[scored])),
                "angle_error_max_rad": finite(np.max(np.abs(error[scored]))),
                "rate_error_rms_rad_s": None
                if course.rate is None
                else finite(rms((course.rate - reference.at(course.tick)[1])[scored])),
                "stiffness_error": _parameter_error(course, reference, STIFFNESS, self._k),
                "damping_error": _parameter_error(course, reference, DAMPING, mean),
                "damping_expanded": self._deviation(course, DAMPING, mean),
                "settled_s": float(seconds[settled]) if settled < len(seconds) - _HELD * scored.sum() else None,
                "diverged_s": min(found) if found else None,
            }
        )

    def _from_start(self, tick: npt.NDArray[np.int64], values: Floats) -> Floats:
        first = int(np.searchsorted(tick / self.rate_Hz, self.from_s))
        return np.asarray(values - values[min(first, len(values) - 1)])

    def _notfinite(self, course: MethodCourse) -> float | None:
        wrong = np.flatnonzero(~np.isfinite(course.angle))
        return float(course.tick[wrong[0]] / self.rate_Hz) if wrong.size else None

    @staticmethod
    def _deviation(course: MethodCourse, names: tuple[str, ...], unit: float | None) -> float | None:
        found = [course.deviations[name] for name in names if name in course.deviations]
        return finite(COVERAGE * rms(np.array(found)) / unit) if found and unit else None


def _parameter_error(
    course: MethodCourse, reference: Reference, names: tuple[str, ...], unit: float | None
) -> float | None:
    known = [name for name in names if name in course.parameters and name in reference.parameters]
    if not known or not unit:
        return None
    return finite(rms(np.array([course.parameters[n] - reference.parameters[n] for n in known])) / unit)


def _last(bad: npt.NDArray[np.bool_]) -> int:
    """The first place behind the last that is bad."""
    found = np.flatnonzero(bad)
    return int(found[-1]) + 1 if found.size else 0


def rms(values: Floats) -> float:
    with np.errstate(all="ignore"):
        return float(np.sqrt(np.mean(np.square(values))))


@dataclass(frozen=True)
class Given:
    """A record with its bench: samples a row a tick, how a drive that is missing was predicted, and the commercial gyro
    that was recorded during the run, or why there is none."""

    captured: Capture
    bench: Bench
    samples: Samples
    drives: Drives | None
    beside: ReferenceRate | str = ""

    @property
    def device(self) -> Device:
        return recorded_device_of(self.bench, self.captured)

    @property
    def settings(self) -> ObserverSettings:
        return observer_settings_of(self.bench)

    @property
    def control(self) -> ControllerSettings | None:
        """What is known of the control that was at work."""
        return control_of(self.bench, self.captured)

    @property
    def sense(self) -> Array:
        """Voltages (n, 2), NaN where a sample was lost."""
        return self.samples.sense

    @property
    def streams(self) -> bool:
        return self.captured.carrier_Hz is not None

    @cached_property
    def closing_scan(self) -> "tuple[Information | None, Scan | None]":
        """What the scan that closes a run says of the record; nothing of demodulated streams."""
        if self.streams:
            return None, None
        began = time.perf_counter()
        found = scan_of(self.captured, self.bench, alarms_only)
        return found.information, to_model(found, began)

    @property
    def scored_from_s(self) -> float:
        """Bench time at which the scored window begins."""
        rate_Hz = self.device.sample_rate
        return scored_from_s(float(self.samples.tick[0]) / rate_Hz, self.bench.loop.settle_s, rate_Hz)

    @property
    def seconds(self) -> float:
        return len(self.samples.tick) / self.device.sample_rate


def given(capture: Path, bench: Bench) -> Given:
    """Read a record.  Raises InputError for one that is not of this bench file, has one axis or no even steps."""
    if bench.device.axes != 2:
        raise InputError(f"{capture}: [device] axes = {bench.device.axes}; methods are compared by their angle, of two")
    captured, bench = fitting(capture, bench)
    captured, bench, _ = at_rest(captured, bench, trims_beside(capture))
    if not captured.uniform:
        raise InputError(f"{capture}: unevenly sampled, which only the observers can read; `hil replay` runs one")
    drives = drives_of(captured, recorded_device_of(bench, captured))
    beside = reference_rate(RunFolder(capture.parent)) if capture.name == "capture.arrow" else ""
    return Given(captured, bench, samples_of(captured, drives), drives, beside)
