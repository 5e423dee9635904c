"""An observer of the loop in which a plug-in stands for the observer, the controller, or both.

What a plug-in says goes through the checks in C (native/step.h) and stands where the core would have put it: what
records, scores or reports does not ask whose it is.
"""

import ctypes
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from estimator.core.layout import OUTPUT
from estimator.core.library import LIBRARY as CORE
from estimator.core.structures import Arrays
from estimator.observer import Estimates, Observer
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, Variant
from estimator.trims import Electrode
from hil.errors import InputError
from hil.numbers import with_and
from hil.plugins import native
from hil.plugins.finding import METHODS
from hil.plugins.native import Fault, Part, PluginState
from hil.plugins.parts import Named, PluginPart, fault_words
from hil.plugins.protocol import DeclaredDevice, PluginError

_MOST_GROWTH = 1 << 29  # bytes that a run's process may take more than it had when it began


class Plugged(Observer):
    """An observer with plug-ins in it; `parts` are theirs, each in the places that it says."""

    def __init__(
        self, device: Device, settings: ObserverSettings, controller: ControllerSettings, parts: Sequence[PluginPart]
    ) -> None:
        super().__init__(device, settings, controller)
        self.parts = tuple(parts)
        self._asked = controller
        self._native = native.library()
        self._plugin = PluginState(states=len(self.names), step_s=1.0 / device.sample_rate)
        self._codes = (ctypes.c_double * 2)()
        self._step = ctypes.cast(self._native.plugin_step, ctypes.c_void_p).value or 0
        if len(self.names) > native.STATES:
            raise InputError(f"{len(self.names)} states and coefficients; a plug-in's estimate has {native.STATES}")

    def _begin(self, own: Observer) -> None:
        """Make the instances; `own` is the bench's estimator for whatever they do not do."""
        self._own = own
        state, part_of = self._plugin, {kind: part for part in self.parts for kind in part.kinds}
        sizes = (ctypes.c_int64 * 2)(*(part.size for part in self.parts))
        if not self._native.plugin_lend(ctypes.byref(state), sizes):
            raise InputError(f"{self.parts[0].called}: there is no memory for an instance of {sum(sizes)} bytes")
        declared = DeclaredDevice.of(self.device, self._asked)
        for name, value in vars(declared).items():
            if isinstance(value, tuple):
                getattr(state.device, name)[:] = value
            else:
                setattr(state.device, name, value)
        state.code_limit = math.floor(declared.drive_limit_mps2 / declared.drive_scale_mps2 * (1.0 + 1e-12))
        state.limit_ns, state.drive_on = (1 << 62), 0
        self._lend_own(own)
        state.declared = self._declared.ctypes.data
        for at, part in enumerate(self.parts):
            part.begin(state, at, declared, self.names)
            self._check()
        for kind, part in part_of.items():
            setattr(state, METHODS[kind], part.address(kind))
            setattr(state, kind, state.lent[self.parts.index(part)].at)

    def _lend_own(self, own: Observer) -> None:
        lent, arrays = self._plugin.own, own.arrays
        lent.estimator = own.filter.address
        for name in ("observe", "passed", "follow", "control", "commanded", "trimmed"):
            setattr(lent, name, ctypes.cast(getattr(CORE, f"estimator_{name}"), ctypes.c_void_p).value)
        actual = arrays.c if arrays.settings["two_covariances"][0] else arrays.p
        self._entries = np.ascontiguousarray(own.estimated_index, np.int64)
        lent.x, lent.variance, lent.row = arrays.x.ctypes.data, actual.ctypes.data, arrays.rows.ctypes.data
        lent.factors, lent.entries = own.factors.ctypes.data, self._entries.ctypes.data
        lent.estimated = len(self._entries)
        lent.volts[:] = own.volts
        lent.per_second = 1.0 / own.scaling.omega0
        self._declared = own.x * own.factors
        self._held = (own, arrays, actual)

    def close(self) -> None:
        """Give the instances back."""
        self._native.plugin_give_back(ctypes.byref(self._plugin))

    # -- watched -----------------------------------------------------------------------------------------------------

    def allow(self, limit_s: float) -> None:
        """A call may take so long."""
        self._plugin.limit_ns = round(1e9 * limit_s)

    def begin_running(self) -> None:
        """From now on this process must not grow without bounds."""
        if (arrow := sys.modules.get("pyarrow")) is not None:
            arrow.allocate_buffer(1)  # at its first use it reserves a gigabyte, which is none of the plug-in's
        self._plugin.most_pages = _MOST_GROWTH // 4096
        self._native.plugin_remember(ctypes.byref(self._plugin))

    def tell_failure_to(self, address: int) -> None:
        """A number in memory that becomes 1 when something is wrong."""
        self._plugin.failed = address

    @property
    def origin(self) -> dict[str, str]:
        """Whose estimates these are, by place."""
        return {kind: part.name.rpartition("/")[2] for part in self.parts for kind in part.kinds}

    @property
    def samples(self) -> int:
        """That it has been given."""
        return int(self._plugin.number)

    def failure(self) -> PluginError:
        """What was wrong with a plug-in, as the loop ends for it."""
        state = self._plugin
        kind = "observer" if state.part == Part.OBSERVE else "controller"
        part = next((part for part in self.parts if kind in part.kinds), self.parts[0])
        if state.fault == Fault.NUMBER and (why := part.why()):
            return PluginError(f"{part.called}: {why}, at sample {self.samples}")
        if state.fault == Fault.RAISED and part.raised is not None:
            from hil.plugins.finding import said

            what = f"{'observe' if kind == 'observer' else 'control'} raised {said(part.raised)}"
        else:
            what = fault_words(state, self.names)
        return PluginError(f"{part.called}: {what}, at sample {self.samples}")

    @property
    def remarks(self) -> list[str]:
        """What it did that ends no run, a line each."""
        state = self._plugin
        names = [name for at, name in enumerate(self.names) if state.withdrawn >> at & 1]
        if not names:
            return []
        part = next(part for part in self.parts if "observer" in part.kinds)
        declared = "its declared value stands" if len(names) == 1 else "their declared values stand"
        return [
            f"{part.called}: gave NaN for {with_and(names)}, first at sample {state.withdrawn_at}; {declared} instead"
        ]

    @property
    def figures(self) -> list[Named]:
        """What its parts tell of themselves."""
        return [figure for part in self.parts for figure in part.figures()]

    def _check(self) -> None:
        if self._plugin.fault:
            raise self.failure()

    # -- as an observer of the loop ------------------------------------------------------------------------------------

    @property
    def core(self) -> int:
        """What `step` is given."""
        return ctypes.addressof(self._plugin)

    @property
    def step(self) -> int:
        """The checks, with the plug-in behind them."""
        return self._step

    @property
    def carries_angle(self) -> bool:
        """Never: a plug-in sees to its own angle."""
        return False

    def enable_control(self, on: bool) -> None:
        """Also of the plug-in's controller: its drive is applied from now on, or not."""
        super().enable_control(on)
        self._plugin.drive_on = int(on)

    def tick(self, vx: float, vy: float, ux: float, uy: float) -> tuple[int, int]:
        """As the core's. Raises PluginError where something is wrong with it."""
        self._native.plugin_step(ctypes.byref(self._plugin), vx, vy, ux, uy, self._codes)
        self._check()
        return int(self._codes[0]), int(self._codes[1])

    def lose_phase(self, missing: int) -> None:
        """Samples without drive are missing: each is told as lost."""
        for _ in range(missing):
            self.tick(math.nan, math.nan, 0.0, 0.0)
            self.withdraw()

    def lose_motion(self, kept: Sequence[Array] | None = None) -> None:
        """Nothing: a plug-in finds the motion again by the samples."""


class PluggedController(Plugged):
    """The bench's own observer, with a plug-in's controller."""

    def __init__(
        self, device: Device, settings: ObserverSettings, controller: ControllerSettings, parts: Sequence[PluginPart]
    ) -> None:
        super().__init__(device, settings, controller, parts)
        self._begin(self)


class PluggedObserver(Plugged):
    """A plug-in's observer, with its own controller, another plug-in's, or the bench's.

    Its arrays are in SI; it has no covariance.  `own` follows it for the control law.
    `streams`: the device as demodulated streams show it, whose rows are then taken.
    """

    HAS_COVARIANCE: ClassVar[bool] = False

    def __init__(
        self,
        device: Device,
        settings: ObserverSettings,
        controller: ControllerSettings,
        parts: Sequence[PluginPart],
        streams: Device | None = None,
    ) -> None:
        whole = replace(settings, variant=Variant.FULL, gain=Gain.EKF)
        super().__init__(device, whole, controller, parts)
        self.settings = settings
        own = Observer(device, whole, controller)
        n = len(self.names)
        self.x = own.x * own.factors
        self.factors, self.volts = np.ones(n), np.ones(2)
        self.trims = own.trims
        self.estimated_index = np.arange(n)
        self._p = self._c = np.zeros((n, n))
        state = self._plugin
        state.state, state.variance = self.x.ctypes.data, self._p.ctypes.data
        state.row = self._rows.ctypes.data
        if streams is not None:
            self.device, state.step_s = streams, 1.0 / streams.sample_rate
        self._begin(own)

    @property
    def arrays(self) -> Arrays:
        """Its own, in SI, with the queue of commands that `own` keeps."""
        return super().arrays._replace(memory=self._own.arrays.memory)

    def declare_trims(self, electrodes: Sequence[Electrode]) -> None:
        """The plug-in is told of them. Raises InputError for one that cannot be."""
        part = next(part for part in self.parts if "observer" in part.kinds)
        self._plugin.trimmed = part.trimmed()
        if electrodes and not self._plugin.trimmed:
            lacks = "a method trimmed" if part.in_python else "a function gyro_plugin_trimmed"
            raise InputError(
                f"{part.called}: [trim] electrodes change the springs, and it cannot be told of their voltages; give "
                f"it {lacks}, or take the table out"
            )
        self._own.declare_trims(electrodes)
        told = native.Trims.from_address(self._plugin.trims)
        told.count = len(electrodes)
        for k, one in enumerate(electrodes):
            told.softening_per_s2_per_V2[k][:] = one.softening
            told.softening_u_per_s2_per_V2[k][:] = one.softening_u
            told.settling_s[k] = one.settling

    def enable_control(self, on: bool) -> None:
        """Of the part that controls."""
        super().enable_control(on)
        self._own.enable_control(on)

    def expected_drive(self) -> tuple[float, float]:
        """As `own` has it."""
        return self._own.expected_drive()

    def withdraw(self) -> None:
        """As of `own`."""
        self._own.withdraw()

    def scale_target(self, factor: float) -> None:
        """Of the bench's own control law."""
        self._own.scale_target(factor)

    def retarget(self, stiffness: float, amplitude: float) -> None:
        """Likewise."""
        self._own.retarget(stiffness, amplitude)

    def turn(self, virtual_rotation: float) -> None:
        """Likewise."""
        self._own.turn(virtual_rotation)

    def dither(self, rms: float) -> None:
        """Likewise."""
        self._own.dither(rms)

    def run(
        self,
        sense: Array,
        drive: Array,
        *,
        step: Array | None = None,
        every: int = 1,
        temperature: Array | None = None,
        truth: Array | None = None,
    ) -> Estimates:
        """As the observer's, of even steps. Raises InputError for others, PluginError where something is wrong with it.
        Of demodulated streams sense and drive are (n, 4): x and y in phase, then both in quadrature.

        Calls go on from one another: `every` counts from the first sample of each.
        """
        if step is not None and not np.allclose(step, 1.0 / self.device.sample_rate, rtol=1e-6):
            raise InputError(f"{self.parts[0].called}: a plug-in takes samples of even steps; this record's are not")
        self._require_rows(len(sense), drive=drive)
        n, entries = len(sense), len(self.names)
        given = [np.ascontiguousarray(values, float) for values in (sense, drive)]
        width = given[0].shape[1]
        given[1] = np.ascontiguousarray(given[1].reshape(n, width, -1)[:, :, 0] * self.device.drive_gain)
        rows, states, deviations = np.zeros(n, OUTPUT), np.zeros((n // every, entries)), np.zeros((n // every, entries))
        filled: list[NDArray[Any]] = [*given, rows, states, deviations]
        addresses = (array.ctypes.data for array in filled)
        self._native.plugin_observe(ctypes.byref(self._plugin), n, width, every, *addresses)
        self._check()
        return self.estimates_of(np.arange(every - 1, n, every), states, deviations, rows)

    def unsettle(self, spread: Array) -> None:
        """Nothing, likewise: it has no covariance that this could widen."""

    @property
    def deviance(self) -> float:
        """Nothing that hindsight could go by."""
        return 0.0
