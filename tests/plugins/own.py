"""The bench's own estimator as a plug-in in Python: what the loop makes of it is known from the loop without one."""

import math
from typing import ClassVar

import hil
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, ObserverSettings, ProcessNoise, Spread
from estimator.trims import Electrode

_MOTION = ("x", "vx", "y", "vy", "rate")


class Own:
    """With the settings of s-slow's bench file."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        self.device = device
        declared = Device(
            sample_rate=device.sample_rate_Hz,
            stiffness=device.stiffness_per_s2,
            damping=device.damping_per_s,
            amplitude=device.amplitude_m,
            sense_gain=device.sense_gain_V_per_m,
            noise=(device.noise_V,) * 2,
            mass=device.mass_kg,
            target_stiffness=device.target_stiffness_per_s2,
        )
        settings = ObserverSettings(
            memory=1.0, spread=Spread(rate=2.0, offset=8.9e-3), process_noise=ProcessNoise(rate=1.0)
        )
        control = ControllerSettings(
            device.latency, device.drive_scale_mps2, device.drive_limit_mps2, device.sense_scale_V,
            virtual_rotation=device.virtual_rotation_rad_s, energy_gain=0.1, quadrature_gain=0.1, dither=0.3,
        )  # fmt: skip
        self.observer = Observer(declared, settings, control)
        self.codes = (0, 0)

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        device, observer = self.device, self.observer
        volts = [value / device.sense_scale_V for value in sense]
        self.codes = observer.tick(*volts, *[value / device.drive_scale_mps2 for value in applied])
        state, deviation = observer.reading()
        named, spread = dict(zip(observer.names, state, strict=True)), dict(zip(observer.names, deviation, strict=True))
        row, of_unit = observer.newest, observer.volts
        x, vx, y, vy, rate = (named.pop(name) for name in _MOTION)
        return hil.Estimate(
            x, vx, y, vy, rate, float(row["angle"]), math.sqrt(max(float(row["angle_variance"]), 0.0)), named, spread,
            tuple(row["nu"] * of_unit), tuple(row["s"] ** 0.5 * abs(of_unit)),
        )  # fmt: skip

    def control(self, estimate: hil.Estimate, on: bool) -> list[float]:
        self.observer.enable_control(on)
        return [code * self.device.drive_scale_mps2 for code in self.codes]


class Trimmed(Own):
    """The same, told of trim voltages; `HEARD` has each call: sample, volts, what they soften."""

    HEARD: ClassVar[list[tuple[int, tuple[float, ...], tuple[float, float, float]]]] = []

    def __init__(self, device: hil.DeclaredDevice) -> None:
        super().__init__(device)
        self.samples = 0
        self.HEARD.clear()

    def trimmed(self, trims: hil.TrimVoltages) -> None:
        if self.samples == 0:  # voltages come as they settle
            rows = zip(trims.softening, trims.softening_u, strict=True)
            self.observer.declare_trims([Electrode(row, u, 0.0) for row, u in rows])
        for k, volts in enumerate(trims.volts):
            self.observer.trims.put(k, volts)
        self.HEARD.append((self.samples, trims.volts, trims.softened))

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        self.samples += 1
        return super().observe(sense, applied, imposed)


class Bare:
    """The same, telling nothing of how sure it is."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        self.own = Own(device)

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        told = self.own.observe(sense, applied, imposed)
        return hil.Estimate(*told[:6], constants=told.constants)


class Law:
    """The source's control law (9) and no more, from the estimate that it is given; the drive begins at once."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        self.device = device

    def control(self, estimate: hil.Estimate, on: bool) -> hil.Drive:
        known, k = estimate.constants, self.device.target_stiffness_per_s2
        dt = (self.device.latency + 0.5) / self.device.sample_rate_Hz
        x, y = estimate.x + dt * estimate.vx, estimate.y + dt * estimate.vy
        vx, vy = estimate.vx - dt * k * estimate.x, estimate.vy - dt * k * estimate.y
        return hil.Drive(
            known["dxx"] * vx + known["dxy"] * vy + (known["kxx"] - k) * x + known["kxy"] * y,
            known["dxy"] * vx + known["dyy"] * vy + known["kxy"] * x + (known["kyy"] - k) * y,
        )


class Backwards(Own):
    """Its angle has the wrong sign."""

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        told = super().observe(sense, applied, imposed)
        return told._replace(angle=-told.angle)


class Adding(Own):
    """It adds the virtual rotation in place of taking it off."""

    added = 0.0

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        told = super().observe(sense, applied, imposed)
        self.added += 2.0 * imposed / self.device.sample_rate_Hz
        return told._replace(angle=told.angle + self.added)


class Slowing(Own):
    """Its rate is half of what it is."""

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        told = super().observe(sense, applied, imposed)
        return told._replace(rate=0.5 * told.rate)
