"""The record that all methods are given, and what is declared of it."""

import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.gaps import Drives
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, ObserverSettings
from hil.bench import Bench
from hil.errors import InputError
from hil.inputs.captured import Samples, at_rest, control_of, drives_of, samples_of
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.progress import alarms_only
from hil.records.capture import Capture
from hil.records.result import Scan
from hil.records.runfolder import RunFolder
from hil.records.table import scored_from_s
from hil.records.trims import trims_beside
from hil.replaying.replay import fitting
from hil.running.closing_scan import scan_of, to_model
from hil.scoring.reference import ReferenceRate, reference_rate

if TYPE_CHECKING:
    from estimator.completeness.information import Information


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
        """What the data sheet declares."""
        return recorded_device_of(self.bench, self.captured)

    @property
    def settings(self) -> ObserverSettings:
        """The bench's observer."""
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
        """Whether it is of demodulated streams."""
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
        """Length in bench time."""
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
