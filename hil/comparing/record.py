"""The record that all methods are given, and what is declared of it."""

from dataclasses import dataclass
from pathlib import Path

from estimator.gaps import Drives
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, ObserverSettings
from hil.bench import Bench
from hil.errors import InputError
from hil.inputs.captured import Samples, control_of, drives_of, samples_of
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.records.capture import Capture, read_capture
from hil.records.table import scored_from_s
from hil.replaying.replay import require_fit


@dataclass(frozen=True)
class Given:
    """A record with its bench: samples a row a tick, and how a drive that is missing was predicted."""

    captured: Capture
    bench: Bench
    samples: Samples
    drives: Drives | None

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
    captured = read_capture(capture)
    require_fit(captured, bench, capture)
    if not captured.uniform:
        raise InputError(f"{capture}: unevenly sampled, which only the observers can read; `hil replay` runs one")
    drives = drives_of(captured, recorded_device_of(bench, captured))
    return Given(captured, bench, samples_of(captured, drives), drives)
