"""Plug-ins of a bench on an emulated device, sample by sample in this process: no wire, no records."""

from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from device_emulator.board import _identity
from device_emulator.device import Device
from device_emulator.scenario import Scenario, load
from estimator.observer import Estimates, Observer
from estimator.settings import ControllerSettings
from hil.bench import Bench
from hil.inputs.declared import device_of, observer_settings_of
from hil.plugins.of_bench import loop_observer, part_of
from hil.plugins.plugged import Plugged, PluggedObserver
from hil.wire.messages import ClockMode


class Driven(NamedTuple):
    """Per sample (n,): rate, angle, its uncertainty, energy over its set point, quadrature; drive (n, 2) m/s² over the
    interval that ends at the sample, sense (n, 2) V; and by name figures and limits."""

    rate: NDArray[np.float64]
    angle: NDArray[np.float64]
    angle_u: NDArray[np.float64]
    energy: NDArray[np.float64]
    quadrature: NDArray[np.float64]
    drive: NDArray[np.float64]
    sense: NDArray[np.float64]
    figures: Mapping[str, float]
    limits: Mapping[str, float | None]


def observed(bench: Bench, plugin: str | None, found: Driven, every: int) -> Estimates:
    """What an observer, without one the bench's own, makes of the record; of every so many samples."""
    device, settings = device_of(bench), observer_settings_of(bench)
    if plugin is None:
        return Observer(device, settings).run(found.sense, found.drive, every=every)
    control = ControllerSettings(latency=1, force_quantum=1e-9, force_limit=1e3, sense_quantum=1e-9)
    return PluggedObserver(device, settings, control, [part_of(["observer"], plugin)]).run(
        found.sense, found.drive, every=every
    )


def drive_directly(bench: Bench, scenario: Scenario | Path, duration_s: float, quiet: int = 10) -> Driven:
    """Run it from `quiet` samples on with the drive applied. Raises PluginError where it gives up."""
    truth = load(scenario) if isinstance(scenario, Path) else scenario
    identity = _identity(truth, (ClockMode.LOCKSTEP,))
    observer: Any = loop_observer(bench, identity)
    assert isinstance(observer, Plugged)
    device, queue = Device(truth), deque([(0, 0)] * identity.latency_ticks)
    n = round(duration_s * identity.tick_rate_Hz)
    rows, drive, shown = np.zeros((n, 5)), np.zeros((n, 2)), np.zeros((n, 2))
    for m in range(n):
        if m == quiet:
            observer.enable_control(True)
        applied = queue.popleft() if m else (0, 0)
        sense = device.rows([applied])[0]
        queue.append(observer.tick(*map(float, sense), *map(float, applied)))
        row = observer.arrays.rows[0]
        rows[m] = observer.x[6], row["angle"], row["angle_variance"], row["energy_ratio"], row["quadrature_ratio"]
        drive[m], shown[m] = applied, sense
    told = observer.figures
    observer.close()
    return Driven(
        rows[:, 0], rows[:, 1], np.sqrt(rows[:, 2]), rows[:, 3], rows[:, 4], drive * identity.drive_scale_mps2,
        shown * identity.sense_scale_V,
        {one.name: one.value for one in told}, {one.name: one.limit for one in told},
    )  # fmt: skip
