"""The observer in SI: built from what the data sheet declares, run over blocks or sample by sample."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.carried_angle import CarriedAngle
from estimator.core.filter import STEP, Filter
from estimator.core.layout import (
    MAX_EFFECTS,
    MAX_ENTRIES,
    MAX_LATENCY,
    MAX_SIGNALS,
    MAX_SLIPS,
    MEMORY,
    OUTPUT,
    SETTINGS,
)
from estimator.core.structures import Arrays
from estimator.core.taylor import taylor_order
from estimator.dither import dither_start
from estimator.effects.catalogue import effect_for
from estimator.effects.declaration import OF_THE_WAY, OWN, Delayed, Effect, Source, name_of
from estimator.errors import ModelError
from estimator.model.catalogue import model_for
from estimator.model.declaration import Constant, Model, Quantity
from estimator.scaling import Array, Scaling
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, Sensed, Variant
from estimator.side_by_side import stop_if_abandoned
from estimator.trims import Electrode, Trims

T = TypeVar("T")

_OF_DISPLACEMENT = (Source.INTEGRAL, Source.RESONATOR)
_PORTION = 4096
"""Samples in one call of a kernel: a tenth of a second where many effects are carried."""


@dataclass(frozen=True)
class Estimates:
    """What the observer made of n samples, SI.

    state, deviation (rows, states + constants): every `every`-th sample, at the sample numbers `index`; innovation and
    its predicted deviation (n, axes) in volts; angle_deviation the standard uncertainty of the angle by estimation,
    since the reference instant; the angles [rad] and ratios (n,) of a two-axis gyro, zeros for a single
    axis.
    """

    names: tuple[str, ...]
    index: NDArray[np.int64]
    state: Array
    deviation: Array
    innovation: Array
    innovation_deviation: Array
    angle: Array
    angle_deviation: Array
    angle_forced: Array
    angle_pattern: Array
    angle_plain: Array
    angle_rate_integral: Array
    energy_ratio: Array
    quadrature_ratio: Array

    def of(self, name: str) -> Array:
        """Column of the state vector by name."""
        return np.asarray(self.state[:, self.names.index(name)])


def active_constants(model: Model, variant: Variant) -> NDArray[np.int64]:
    """Which constants a variant estimates, as indices into `model.constants`."""

    def wanted(constant: Constant) -> bool:
        if variant is Variant.SENSE:
            return constant.quantity in (Quantity.OFFSET, Quantity.RATE)
        if variant is Variant.GYRO:
            return constant.quantity is not Quantity.OFFSET
        return True

    return np.array([i for i, constant in enumerate(model.constants) if wanted(constant)], dtype=np.int64)


def senses_allow(effect: Effect, device: Device) -> bool:
    """Whether an effect is known of what the channels of a device show."""
    if Sensed.ACCELERATION in device.sensed and (effect.slips or effect.delayed is not None):
        return False
    if any(sensed is not Sensed.DISPLACEMENT for sensed in device.sensed):
        return effect.delayed is not Delayed.SENSE and not any(s.source in _OF_DISPLACEMENT for s in effect.signals)
    return True


class Observer:
    """Observer (7)(8) with the gain of choice, and the controller (9) when its settings are given.

    The last `watched` of the settings' effects are not carried: `estimator.core.following` follows their signatures.
    With `known`, the coefficients of the others are constants that are not estimated.

    HAS_COVARIANCE: whether what it estimates comes with one.

    Holds the filter's whole memory; `run` and `tick` advance it.  Raises ModelError for a device or setting that makes
    no observer (no model for the axes, fewer than four samples a cycle, latency beyond the queue).
    """

    HAS_COVARIANCE: ClassVar[bool] = True

    def __init__(
        self,
        device: Device,
        settings: ObserverSettings,
        controller: ControllerSettings | None = None,
        watched: int = 0,
        *,
        known: bool = False,
    ) -> None:
        self.device = device
        self.settings = settings
        self.number, self.model = model_for(device.axes)
        self.scaling = Scaling.of(device)
        self.volts = np.array([self.scaling.sense(axis) for axis in range(device.axes)])  # of a unit of length
        self.effects = tuple(effect_for(name, device.axes, device.own) for name in settings.effects)
        self.carried = len(self.effects) - watched
        coefficients = [coefficient for _, effect in self.effects for coefficient in effect.coefficients]
        self.names = (*self.model.names, *(coefficient.name for coefficient in coefficients))
        self.factors = np.concatenate(
            [self.scaling.state(self.model), [self.scaling.coefficient(c) for c in coefficients]]
        )
        self.h = self.scaling.omega0 / device.sample_rate
        if self.h > 0.5 * math.pi:
            raise ModelError(
                f"{2 * math.pi / self.h:.2g} samples a cycle are too few; "
                f"sample at {2 / math.pi * self.scaling.omega0:.3g} Hz or faster"
            )
        self.states = len(self.model.states)
        base = len(self.model.constants)
        estimated = 0 if known else sum(len(effect.coefficients) for _, effect in self.effects[: self.carried])
        self.active = np.concatenate([active_constants(self.model, settings.variant), base + np.arange(estimated)])
        self.estimated_index = np.concatenate([np.arange(self.states), self.states + self.active])
        if len(self.estimated_index) > MAX_ENTRIES:
            raise ModelError(f"{len(self.estimated_index)} states and constants at once; {MAX_ENTRIES} are supported")
        spread, random_walk = self._spreads()
        self.x = self._initial()
        n = self.states + len(self.active)
        self._p = np.diag(spread**2)
        self._c = self._p.copy()
        self._intensity = random_walk[self.active] ** 2
        self._record = self._recorded(controller)
        self._start = self.x[self.states :][self.active]
        self.first_temperature: float | None = None
        self.trims = Trims()
        self._memory = np.zeros(1, MEMORY)
        self._memory["nis"] = 1.0
        self._memory["dither"] = dither_start(None if controller is None else controller.dither_seed)
        fade = float(self._record["fade"][0])
        forgotten = len(self.active) * (1.0 - 1.0 / fade)  # share of the prior's information, between two visits
        self._motion_spread = spread[: self.states] ** 2
        self._spread = spread[self.states :] ** 2
        self._prior = self._spread / forgotten if forgotten > 0.0 else np.zeros(len(self.active))
        self._table = np.zeros((1, 1, n, self.device.axes))
        self._rows = np.zeros(1, OUTPUT)
        if settings.gain is Gain.STATIONARY:
            from estimator.stationary import stationary_table

            self._table = stationary_table(self.arrays, self.device, settings, self.h)
        self._carried_angle: CarriedAngle | None = None  # while the motion is found anew
        self._filter: Filter | None = None

    # -- construction ------------------------------------------------------------------------------------------------

    def _per_constant(self, values: dict[Quantity, float]) -> Array:
        return np.array([values[constant.quantity] for constant in self.model.constants])

    def _spreads(self) -> tuple[Array, Array]:
        """Scaled initial deviations over [states, active constants], and random-walk deviations over all constants."""
        spread, noise, scaling = self.settings.spread, self.settings.process_noise, self.scaling
        damping = sum(self.device.damping[: self.device.axes]) / self.device.axes
        one = np.abs(self.factors[self.states : len(self.model.names)])
        constants = self._per_constant(
            {
                Quantity.OFFSET: spread.offset,
                Quantity.RATE: spread.rate,
                Quantity.STIFFNESS: spread.stiffness * scaling.omega0**2,
                Quantity.DAMPING: spread.damping * damping,
                Quantity.DRIVE_GAIN: spread.drive_gain * scaling.drive_gain,
            }
        )
        random_walk = self._per_constant(
            {
                Quantity.OFFSET: noise.offset,
                Quantity.RATE: noise.rate,
                Quantity.STIFFNESS: noise.stiffness * scaling.omega0**2,
                Quantity.DAMPING: noise.damping * damping,
                Quantity.DRIVE_GAIN: noise.drive_gain * scaling.drive_gain,
            }
        )
        states = np.tile([spread.position, spread.velocity], self.device.axes)
        root = math.sqrt(scaling.omega0)  # per √s → per √(scaled time)
        plausible = [coefficient.plausible for _, effect in self.effects for coefficient in effect.coefficients]
        constants = np.concatenate([constants / one, plausible])
        return np.concatenate([states, constants[self.active]]), np.concatenate(
            [random_walk / one / root, np.zeros(len(plausible))]
        )

    def _initial(self) -> Array:
        nominal = dict(zip(("kxx", "kyy", "kxy"), self.device.stiffness, strict=False))
        nominal |= dict(zip(("dxx", "dyy", "dxy"), self.device.damping, strict=False))
        nominal |= {"drive_gain_x": self.device.drive_gain}
        nominal |= self.settings.initial
        unknown = set(self.settings.initial) - set(self.model.names)
        if unknown:
            raise ModelError(
                f"no state or constant named {', '.join(sorted(unknown))}; known: {', '.join(self.model.names)}"
            )
        for _, effect in self.effects:
            given = self.settings.effects[effect.name]
            bare = {coefficient.name.partition(":")[0]: coefficient.name for coefficient in effect.coefficients}
            known = [*bare, *(parameter.name for parameter in effect.parameters)]
            if missing := [p.name for p in effect.parameters if p.name not in given and p.default is None]:
                raise ModelError(f"effect {effect.name}: {', '.join(missing)} must be given; it is not estimated")
            if strange := set(given) - set(known):
                raise ModelError(
                    f"effect {effect.name}: no coefficient {', '.join(sorted(strange))}; known: {', '.join(known)}"
                )
            for p in effect.parameters:
                if p.name not in given:
                    continue
                if p.choices and given[p.name] not in p.choices:
                    allowed = " or ".join(f"{value:g}" for value in p.choices)
                    raise ModelError(f"effect {effect.name}: {p.name} is {allowed}, not {given[p.name]:g}")
                if given[p.name] <= p.above:
                    raise ModelError(f"effect {effect.name}: {p.name} is above {p.above:g}, not {given[p.name]:g}")
            nominal |= {name: given[key] for key, name in bare.items() if key in given}
        coefficients = [coefficient for _, effect in self.effects for coefficient in effect.coefficients]
        begun = {c.name: c.start * self.scaling.coefficient(c) for c in coefficients}
        return np.asarray([nominal.get(name, begun.get(name, 0.0)) for name in self.names] / self.factors)

    def _recorded(self, controller: ControllerSettings | None) -> NDArray[np.void]:
        scaling, device, settings = self.scaling, self.device, self.settings
        record = np.zeros(1, SETTINGS)
        record["model"] = self.number
        record["states"] = self.states
        record["sense_constants"] = len(self.model.sense_constants)
        followed = sum(len(effect.coefficients) for _, effect in self.effects[self.carried :])
        record["flow_constants"] = len(self.names) - followed - self.states - len(self.model.sense_constants)
        if len(self.effects) > MAX_EFFECTS:
            raise ModelError(f"{len(self.effects)} effects at once; {MAX_EFFECTS} are supported")
        self._enlist(record)
        record["axes"] = device.axes
        record["h"] = self.h
        record["order"] = taylor_order(self.h)
        fading = settings.gain is not Gain.EKF
        record["fade"] = math.exp(1.0 / (settings.memory * device.sample_rate)) if fading else 1.0
        record["stationary"] = settings.gain is Gain.STATIONARY
        record["takeover"] = settings.takeover * scaling.omega0
        # An offset that is not estimated is a disturbance of the measurement: the gain must not take it for motion.
        ignored = settings.spread.offset if settings.variant is Variant.GYRO else 0.0
        record["two_covariances"] = fading or ignored > 0.0
        self._require_senses(device)
        for axis, sensed in enumerate(device.sensed):
            record["sensed"][0, axis] = sensed.value
        for axis in range(device.axes):
            record["noise"][0, axis] = (device.noise[axis] / scaling.sense(axis)) ** 2
            record["ignored"][0, axis] = (ignored / scaling.sense(axis)) ** 2
            # One-sided density a² [(m/s²)²/Hz] is a velocity variance of a²/2 per second.
            density = settings.process_noise.force**2 / 2.0
            record["force_noise"][0, axis] = density / (device.amplitude**2 * scaling.omega0**3)
        record["stiffness"] = 1.0
        record["energy"] = 0.5
        record["angular_gain"] = device.angular_gain
        record["open_loop"] = settings.open_loop
        record["reference"] = settings.reference * scaling.omega0
        rate = [i for i, constant in enumerate(self.active) if self.names[self.states + constant] == "rate"]
        record["rate_row"] = self.states + rate[0] if rate else -1
        if controller is not None:
            self._control(record, controller)
        return record

    def _require_senses(self, device: Device) -> None:
        """Refuse what is not known of what is sensed."""
        if device.axes != 1 and Sensed.ACCELERATION in device.sensed:
            raise ModelError("acceleration is sensed on a single axis only; trace axis by axis")
        for _, effect in self.effects:
            if not senses_allow(effect, device):
                what = "displacement or a velocity" if effect.slips else "sensed displacement"
                raise ModelError(f"effect {effect.name} is known of a {what} only; leave it out")

    def _enlist(self, record: NDArray[np.void]) -> None:
        """The effects, what they depend on, and which path they delay."""
        first = len(self.model.constants)
        listed: list[tuple[int, int, int, float, float]] = []
        for path in ("sense_delay", "drive_delay", "watched_sense_delay", "watched_drive_delay"):
            record[path] = -1
        for index, (number, effect) in enumerate(self.effects):
            if effect.delayed is not None:
                record[f"{'' if index < self.carried else 'watched_'}{effect.delayed.value}_delay"] = first
            own = self._signals_of(effect, first)
            of_the_way = any(signal.source in OF_THE_WAY for signal in effect.signals)
            # Many effects depend on the same line: one that is there already is followed once.
            place = len(listed) if of_the_way else _place_of(own, listed)
            listed += own if place == len(listed) else []
            code = self._address_of(effect) if number == OWN else number
            record["effects"][0, index] = code, first, place
            if index < self.carried:
                self._enlist_slips(record, effect, place, own)
                record["pushes"] += effect.pushes
                if of_the_way or any(signal.source is Source.DIRECTION for signal in effect.signals):
                    record["kinked"] = 1
                record["carried_signals"] = len(listed)
            first += len(effect.coefficients)
        if len(listed) > MAX_SIGNALS:
            raise ModelError(f"more than {MAX_SIGNALS} signals for the effects; leave one of them out")
        record["effect_count"] = self.carried
        record["candidate_count"] = len(self.effects) - self.carried
        record["signal_count"] = len(listed)
        for number, one in enumerate(listed):
            record["signals"][0, number], record["signal_parameters"][0, number] = one[:3], one[3:]

    def _signals_of(self, effect: Effect, first: int) -> list[tuple[int, int, int, float, float]]:
        """Source, axis, place of a coefficient among the constants and parameters of what an effect depends on."""
        given = self.settings.effects[effect.name]
        scaled = {
            name_of(p): float(given[p.name] / self.scaling.coefficient(p) if p.name in given else p.default or 0.0)
            for p in effect.parameters
        }
        symbols = [name_of(coefficient) for coefficient in effect.coefficients]
        found = []
        for signal in effect.signals:
            one = name_of(signal, "behind")
            behind = first + symbols.index(one) if one in symbols else -1
            one = name_of(signal) if signal.source is Source.PARAMETER else one
            own = [*([scaled[one]] if one in scaled else scaled.values()), 0.0, 0.0]
            found.append((signal.source.value, signal.axis, behind, own[0], own[1]))
        return found

    def _enlist_slips(
        self, record: NDArray[np.void], effect: Effect, place: int, own: Sequence[tuple[int, int, int, float, float]]
    ) -> None:
        """What depends on the way, of an effect whose signals `own` stand at that place."""
        for number, (signal, (source, axis, behind, *_)) in enumerate(zip(effect.signals, own, strict=True), place):
            if signal.source in OF_THE_WAY and axis < self.device.axes:
                slips = int(record["slip_count"][0])
                if slips == MAX_SLIPS:
                    raise ModelError(f"more than {MAX_SLIPS} springs that slip; leave one of them out")
                record["slips"][0, slips] = number, axis, behind, source
                record["slip_count"] = slips + 1

    def _address_of(self, effect: Effect) -> int:
        """Of the code of an effect that is not of the catalogue."""
        from estimator.core.own import address  # and SymPy, which prints it

        return address(effect, self.model)

    def _control(self, record: NDArray[np.void], controller: ControllerSettings) -> None:
        if not 0 <= controller.latency <= MAX_LATENCY:
            raise ModelError(f"drive latency of {controller.latency} samples; 0 to {MAX_LATENCY} are supported")
        if self.device.axes != 2:
            raise ModelError(f"control law (9) needs two axes, the device has {self.device.axes}")
        scaling = self.scaling
        record["control"] = 1
        record["latency"] = controller.latency
        record["energy_gain"] = controller.energy_gain
        record["quadrature_gain"] = controller.quadrature_gain
        record["virtual_rate"] = controller.virtual_rotation / scaling.omega0
        record["reversal"] = controller.virtual_reversal * scaling.omega0
        record["dither"] = controller.dither / scaling.force
        record["modulation"] = controller.modulation
        record["modulation_rate"] = controller.modulation_rate / scaling.omega0
        record["hold"] = math.sin(self.h / 2) / (self.h / 2)
        record["force_limit"] = controller.force_limit / scaling.force
        record["quantum"] = controller.force_quantum / scaling.force
        for axis in range(2):
            record["sense_scale"][0, axis] = controller.sense_quantum / scaling.sense(axis)

    # -- in C ---------------------------------------------------------------------------------------------------------

    @property
    def filter(self) -> Filter:
        """The filter in the core, about this observer's arrays."""
        if self._filter is None:
            self._filter = Filter(self.arrays)
        return self._filter

    @property
    def core(self) -> int:
        """Its address, for a caller in C (`estimator_tick`); good as long as this observer lives."""
        return self.filter.address

    @property
    def step(self) -> int:
        """Address of the function that a caller in C gives `core` and a sample to."""
        return STEP

    @property
    def carries_angle(self) -> bool:
        """Whether the angle is carried on by the rate: then `tick` has more to do than the core."""
        return self._carried_angle is not None

    def __getstate__(self) -> dict[str, Any]:
        """What is kept of it: all but the filter in the core, which holds addresses."""
        return {**self.__dict__, "_filter": None}

    # -- state in SI -------------------------------------------------------------------------------------------------

    @property
    def state(self) -> Array:
        """State vector X̂ (states + constants,), SI."""
        return np.asarray(self.x * self.factors)

    @property
    def covariance(self) -> Array:
        """Covariance the estimates have under this gain, over [states, active constants], SI."""
        return self.covariance_of(self._actual)

    def covariance_of(self, scaled: Array) -> Array:
        """What the core has of one (n, n), in SI."""
        scale = self.factors[self.estimated_index]
        return np.asarray(scaled * np.outer(scale, scale))

    @property
    def _actual(self) -> Array:
        """The same, scaled; lent."""
        return self._c if self._record["two_covariances"][0] else self._p

    @property
    def coefficient_units(self) -> dict[str, str]:
        """SI unit of each effect's coefficient, by name."""
        return {c.name: c.unit for _, effect in self.effects for c in effect.coefficients}

    @property
    def estimated(self) -> tuple[str, ...]:
        """Names behind the rows of `covariance`."""
        return tuple(self.names[i] for i in self.estimated_index)

    @property
    def arrays(self) -> Arrays:
        """What a kernel takes."""
        return Arrays(
            self._record, self.active, self._intensity, self._prior, self._spread, self._start, self._table,
            self.x, self._p, self._c, self._memory, self._rows, self.trims.record,
        )  # fmt: skip

    @property
    def covariances(self) -> tuple[Array, Array]:
        """Scaled covariances (n, n) over [states, active constants]: the one that the gain assumes, and the one that
        the estimates have under it.
        """
        return self._p.copy(), self._c.copy()

    @property
    def _first_coefficient(self) -> int:
        """Row of the covariance from which on the coefficients of the effects that are carried stand."""
        carried = self.effects[: self.carried]
        return self.states + len(self.active) - sum(len(effect.coefficients) for _, effect in carried)

    @property
    def random_walk_intensity(self) -> Array:
        """Intensity (k,) of the random walk of each active constant: the square of its density, per scaled second."""
        return np.array(self._intensity)

    @property
    def force_noise(self) -> Array:
        """Scaled variance (axes,) of the velocity per scaled second that the random force makes."""
        return np.array(self._record["force_noise"][0, : self.device.axes], dtype=float)

    @property
    def sense_noise(self) -> Array:
        """Scaled variance (axes,) of a sample."""
        return np.array(self._record["noise"][0, : self.device.axes], dtype=float)

    @property
    def sense_quantum(self) -> Array:
        """What a sense code is worth, V (2,)."""
        return np.array([float(self._record["sense_scale"][0, axis]) * self.scaling.sense(axis) for axis in range(2)])

    @property
    def drive_quantum(self) -> float:
        """What a drive code is worth, in the unit of the drive."""
        return float(float(self._record["quantum"][0]) * self.scaling.drive)

    @property
    def latency(self) -> int:
        """Samples from a sample to where its command acts."""
        return int(self._record["latency"][0])

    @property
    def initial_deviations(self) -> Array:
        """Scaled standard deviations (n,) with which [states, active constants] began."""
        return np.asarray(np.sqrt(np.concatenate([self._motion_spread, self._spread])))

    @property
    def newest(self) -> np.void:
        """The row that every tick fills (`estimator.core.layout.OUTPUT`), scaled; lent, the same one each time."""
        row: np.void = self._rows[0]
        return row

    @property
    def deviance(self) -> float:
        """−2 log of the density of the newest innovation, less a constant."""
        out = self._rows[0]
        return float(np.sum(out["nu"] ** 2 / out["s"] + np.log(out["s"])))

    # -- beginning, and beside another -----------------------------------------------------------------------------

    def begin_moving(self, motion: Array) -> None:
        """Begin with these displacements and velocities (2, axes), m and m/s, at the start of the first interval."""
        self.x[: self.states] = np.asarray(motion).T.ravel() / self.factors[: self.states]

    def begin_at(self, seconds: float, temperature: float | None) -> None:
        """What effects count from is a record's own beginning, so long ago, and its first temperature."""
        self._memory["time"] = seconds * self.scaling.omega0
        if temperature is not None:
            self.first_temperature = temperature

    def declare_trims(self, electrodes: Sequence[Electrode]) -> None:
        """Have trim electrodes, of which `trims` is told the voltages. Raises ModelError for a single axis."""
        if self.device.axes != 2:
            raise ModelError("trim electrodes are of a gyro with two axes; leave out [trim]")
        self.trims.declare(electrodes, self.scaling.omega0, self.estimated)

    def hold(self, names: Iterable[str]) -> None:
        """Keep constants or coefficients where they are: known, so nothing of them is learnt or forgotten."""
        rows = np.array([self.estimated.index(name) for name in names], dtype=int)
        for covariance in (self._p, self._c):
            covariance[rows, :] = 0.0
            covariance[:, rows] = 0.0
        for own in (self._intensity, self._spread, self._prior):
            own[rows - self.states] = 0.0

    def rest_constants(self) -> None:
        """Constants do not walk in the covariance of the estimates, though the gain allows for it: what noise alone
        makes of them.  For an observer that has not begun: from now on it carries both covariances.
        """
        self._record["resting"] = self._record["two_covariances"] = 1

    def refer_angle(self) -> None:
        """Count the angle's uncertainty from the next sample on."""
        self._memory["referred"] = 0

    @property
    def pattern_variance(self) -> float:
        """Variance [rad²] of the pattern angle, as it is estimated now."""
        gradient = self._memory["gradient"][0, : len(self._actual)]
        return float(gradient @ self._actual @ gradient)

    def hold_coefficients(self) -> None:
        """Keep those of all effects that are carried."""
        self.hold(self.estimated[self._first_coefficient :])

    def assume(self, names: Sequence[str], covariance: Array) -> None:
        """Constants or coefficients are known with this covariance (k, k), SI, and share nothing with the others."""
        rows = [self.estimated.index(name) for name in names]
        scale = self.factors[self.estimated_index][rows]
        for own in (self._p, self._c):
            own[rows, :] = 0.0
            own[:, rows] = 0.0
            own[np.ix_(rows, rows)] = covariance / np.outer(scale, scale)

    def allow_steps(self, longest: float, degree: int) -> None:
        """Integrate steps up to `longest`, scaled, under a drive that is a polynomial of that degree."""
        self._record["order"] = taylor_order(longest) + degree

    @contextmanager
    def noisier(self, factor: float) -> Iterator[None]:
        """Within, a sample's variance is so many times what the device declares."""
        declared = self._record["noise"].copy()
        self._record["noise"] = declared * factor
        try:
            yield
        finally:
            self._record["noise"] = declared

    def adopt(self, other: "Observer", *, commands: bool = True) -> None:
        """Go on from where `other` is, an observer of the same device and settings; without `commands`, what was
        commanded here stays what was commanded.
        """
        queue = self._memory["queue"].copy()
        for mine, its in ((self.x, other.x), (self._p, other._p), (self._c, other._c), (self._memory, other._memory)):
            mine[:] = its
        self.trims.record[:], self._start[:] = other.trims.record, other._start
        self._carried_angle = copy(other._carried_angle)
        if not commands:
            self._memory["queue"] = queue

    def obey(self, other: "Observer") -> None:
        """Have the settings of control that `other` has now."""
        self._record[:] = other._record

    # -- advancing ---------------------------------------------------------------------------------------------------

    def enable_control(self, on: bool) -> None:
        """Switch the commanded force between the control law and zero."""
        self._record["control"] = int(on)

    def scale_target(self, factor: float) -> None:
        """Make the controller's target stiffness so many times the declared one."""
        self._record["stiffness"] = factor

    def retarget(self, stiffness: float, amplitude: float) -> None:
        """Make the controller's target stiffness and the amplitude that it holds so many times the declared ones."""
        self._record["stiffness"] = stiffness
        self._record["energy"] = 0.5 * stiffness * amplitude**2

    @property
    def target_stiffness(self) -> float:
        """The controller's, by now, 1/s²."""
        return float(self._record["stiffness"][0]) * self.scaling.omega0**2

    def turn(self, virtual_rotation: float) -> None:
        """Impose another virtual rotation [rad/s]."""
        self._record["virtual_rate"] = virtual_rotation / self.scaling.omega0

    def dither(self, rms: float) -> None:
        """Add another random force [m/s²] to each command."""
        self._record["dither"] = rms / self.scaling.force

    def tick(self, vx: float, vy: float, ux: float, uy: float) -> tuple[int, int]:
        """One sample of the closed loop: sense codes (NaN where lost) and echoed drive codes in, drive codes out."""
        codes = self.filter.tick(vx, vy, ux, uy)
        if self._carried_angle is not None:
            self._follow(self._rows)
        return codes

    def expected_drive(self) -> tuple[float, float]:
        """Drive codes that the board is expected to have applied over the interval that ends at the next sample."""
        quantum = float(self._record["quantum"][0])
        ux, uy, _ = self._memory["queue"][0, 0] / quantum
        return float(ux), float(uy)

    def withdraw(self) -> None:
        """The newest command was not sent: the board will hold the one before it."""
        latency = int(self._record["latency"][0])
        if latency > 0:
            self._memory["queue"][0, latency] = self._memory["queue"][0, latency - 1]

    def lose_phase(self, missing: int) -> None:
        """Go on after a gap of `missing` samples without drive: constants are kept, the motion is found anew, and the
        angle is carried on by the rate until it is.
        """
        kept = self._of_constants()
        self._memory["queue"] = 0.0
        self.run(np.full((missing, 2), math.nan), np.zeros((missing, 2)), every=max(missing, 1))
        self.lose_motion(kept)

    def unsettle(self, spread: Array) -> None:
        """The motion is less certain than the filter knows by the covariance `spread` (states, states) of positions and
        velocities, SI: a drive acted that nobody knows.  Infinite: it is found anew.
        """
        if not np.all(np.isfinite(spread)):
            self.lose_motion()
            return
        scale = self.factors[: self.states]
        for covariance in (self._p, self._c):
            covariance[: self.states, : self.states] += spread / np.outer(scale, scale)

    def lose_motion(self, kept: Sequence[Array] | None = None) -> None:
        """Begin with the motion anew, and carry the angle on by the rate until it is found; `kept` is what stays of the
        two covariances, that of the constants, by default as it is.
        """
        kept = self._of_constants() if kept is None else kept
        for covariance, block_of_constants in zip((self._p, self._c), kept, strict=True):
            covariance[:] = 0.0
            covariance[self.states :, self.states :] = block_of_constants
            covariance[: self.states, : self.states] = np.diag(self._motion_spread)
        self._carry_angle()

    def _of_constants(self) -> list[Array]:
        """That of the constants in both covariances."""
        return [covariance[self.states :, self.states :].copy() for covariance in (self._p, self._c)]

    def _carry_angle(self) -> None:
        """Go on with the angle by the rate alone until the motion is found. In open loop it always does."""
        if self.device.axes == 2 and self._memory["started"][0] and not self._record["open_loop"][0]:
            rate, gain = int(self._record["rate_row"][0]), float(self._record["angular_gain"][0])
            self._carried_angle = CarriedAngle(self._memory, self.states, rate, 1.0 / gain)

    def _portion(self) -> int:
        """Samples that the next call of a kernel may have: a cycle, while the angle is carried on."""
        return _PORTION if self._carried_angle is None else math.ceil(2.0 * math.pi / self.h)

    def _follow(self, rows: NDArray[np.void]) -> None:
        """See to the newest output rows where the angle is carried on."""
        if self._carried_angle is not None and self._carried_angle.follow(self._memory, rows, self._actual):
            self._carried_angle = None

    def reading(self) -> tuple[list[float], list[float]]:
        """Newest state vector and its standard deviations, SI, in the order of `model.names`; 0 for what is not
        estimated.
        """
        deviation = np.zeros(len(self.x))
        deviation[self.estimated_index] = np.sqrt(np.diagonal(self._actual))
        return (self.x * self.factors).tolist(), (deviation * np.abs(self.factors)).tolist()

    def scaled(
        self, sense: Array, drive: Array, step: Array | None, temperature: Array | None
    ) -> tuple[Array, Array, Array, Array]:
        """What `run` is given, as the kernels take it: z (n, axes), u (n, axes, degree + 1), h (n,), temperature."""
        n, axes = len(sense), self.device.axes
        z = np.ascontiguousarray(sense, dtype=float) / self.volts
        u = np.ascontiguousarray(np.asarray(drive, dtype=float).reshape(n, axes, -1) / self.scaling.drive)
        h = np.full(n, self.h) if step is None else np.asarray(step, dtype=float) * self.scaling.omega0
        return z, u, h, self._warmth(temperature)

    def _warmth(self, temperature: Array | None) -> Array:
        """Temperature less its first reading (n,), none where none is measured."""
        if temperature is None:
            return np.zeros(0)
        readings = np.ascontiguousarray(temperature, dtype=float)
        if self.first_temperature is None and len(readings):
            self.first_temperature = float(readings[0])
        return np.asarray(readings - (self.first_temperature or 0.0))

    @staticmethod
    def _require_rows(rows: int, **arrays: Array | None) -> None:
        for name, array in arrays.items():
            if array is not None and len(array) != rows:
                raise ModelError(f"{name} has {len(array)} rows, sense has {rows}; give each sample its own")

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
        """Estimate over a record: sense (n, axes) in volts, drive (n, axes) or (n, axes, degree + 1) in the drive's
        unit.

        drive[m] acted over the interval that ends at sample m, as a constant or as polynomial coefficients in
        normalised time (`estimator.hold`); step (n,) [s] gives each interval its own length; temperature (n,) [°C or K]
        serves the effects that move with it; truth (n, states + constants) SI replaces the state before each step (for
        the Cramér–Rao recursion, `estimator.bound`).

        Raises ModelError for arrays of unequal length and for an interval too long for the flow.
        """
        self._require_rows(len(sense), drive=drive, step=step, temperature=temperature, truth=truth)
        n = len(sense)
        z, u, h, warmth = self.scaled(sense, drive, step, temperature)
        true = np.zeros((0, len(self.x))) if truth is None else np.ascontiguousarray(truth / self.factors)
        rows = np.zeros(n, OUTPUT)
        states = np.zeros((n // every, len(self.x)))
        deviations = np.zeros_like(states)
        order = int(self._record["order"][0])
        longest = self.h if step is None else float(np.max(h, initial=self.h))
        self.allow_steps(longest, u.shape[2] - 1)
        self._advance(z, u, h, warmth, true, rows, states, deviations, every)
        self._record["order"] = order
        return self.estimates_of(np.arange(every - 1, n, every), states, deviations, rows)

    def observe(self, z: Array, u: Array, rows: NDArray[np.void]) -> None:
        """As `run`, with what is scaled already: z (n, axes), u (n, axes); fills rows (n,) of OUTPUT."""
        none = np.zeros((0, len(self.x)))
        h = np.full(len(z), self.h)
        self._advance(z, u[:, :, np.newaxis], h, np.zeros(0), none, rows, none, none, len(z) + 1)

    def _advance(
        self,
        z: Array,
        u: Array,
        h: Array,
        warmth: Array,
        true: Array,
        rows: NDArray[np.void],
        states: Array,
        deviations: Array,
        every: int,
    ) -> None:
        for rows_of, states_of, stride in _portions(len(z), every, self._portion):
            stop_if_abandoned()
            self.filter.run(
                z[rows_of], u[rows_of], h[rows_of], warmth[rows_of], true[rows_of], rows[rows_of], states[states_of],
                deviations[states_of], stride,
            )  # fmt: skip
            self._follow(rows[rows_of])

    def estimates_of(
        self, index: NDArray[np.int64], states: Array, deviations: Array, rows: NDArray[np.void]
    ) -> Estimates:
        """What the core has put down, in SI: states and deviations (m, states + constants) of the samples at `index`,
        scaled, and rows (n,) of OUTPUT.
        """
        axes = self.device.axes
        with np.errstate(invalid="ignore"):  # below zero, no variance of anything: the filter has diverged
            innovation_deviation = np.sqrt(rows["s"][:, :axes]) * np.abs(self.volts)
        return Estimates(
            names=self.names,
            index=index,
            state=states * self.factors,
            deviation=deviations * np.abs(self.factors),
            innovation=rows["nu"][:, :axes] * self.volts,
            innovation_deviation=innovation_deviation,
            angle=rows["angle"],
            angle_deviation=np.sqrt(np.maximum(rows["angle_variance"], 0.0)),
            angle_forced=rows["angle_forced"],
            angle_pattern=rows["angle_pattern"],
            angle_plain=rows["angle_plain"],
            angle_rate_integral=rows["angle_rate_integral"],
            energy_ratio=rows["energy_ratio"],
            quadrature_ratio=rows["quadrature_ratio"],
        )


def _portions(n: int, every: int, portion: Callable[[], int]) -> Iterator[tuple[slice, slice, int]]:
    """n samples in portions, so that Ctrl-C waits for one of them and not for the record: its samples,
    its rows of the state, which is kept at every `every`-th, and the stride that does that within the portion.
    `portion` is asked before each how many samples it may have; it has whole strides, or lies within one.
    """
    begin = 0
    while begin < n:
        most = portion()
        stretch = most // every * every if begin % every == 0 and most >= every else every - begin % every
        end = min(begin + min(most, stretch), n)
        rows = slice(begin // every, end // every)
        stride = min(every, end - begin) if rows.stop > rows.start else end - begin + 1
        yield slice(begin, end), rows, stride
        begin = end


def _place_of(part: Sequence[T], whole: Sequence[T]) -> int:
    """Where a part stands in a sequence; the end of that where it does not."""
    places = (k for k in range(len(whole) - len(part) + 1) if list(whole[k : k + len(part)]) == list(part))
    return next(places, len(whole))
