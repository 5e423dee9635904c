"""From what is declared, by bench file and board, to what the estimator needs."""

import math
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Literal, NamedTuple

from estimator import settings
from estimator.envelope.record import Resonator
from estimator.gain_matrix import BoardFilter, luenberger, pair
from hil.bench import Bench
from hil.bench.classic import PLUGIN
from hil.bench.device import DriveUnit
from hil.errors import InputError
from hil.inputs.own_effects import included, own_effects
from hil.numbers import percent, quantity
from hil.wire.messages import Identity
from hil.wire.spec import SPEC

if TYPE_CHECKING:
    from hil.records.capture import Capture


def device_of(bench: Bench, noise_gain: float = 1.0, drive_unit: DriveUnit | None = None) -> settings.Device:
    """The declared device per unit mass, with the effects beside the catalogue that it can have; noise_gain: what a
    filter that its record passed left of the noise; drive_unit: that of the drive it is given, without it the bench's.

    Raises InputError for one of which only the envelope is sensed: no observer follows an amplitude.
    """
    if bench.device.sense.is_envelope:
        raise InputError(
            f'{bench.device.name}: [device.sense] senses = "envelope" is an amplitude without its waveform, which only '
            "hil trace can judge; give the bench file of a record of the motion"
        )
    return _declared(bench, noise_gain, drive_unit or bench.device.drive.unit)


def board_device_of(bench: Bench) -> settings.Device:
    """The device behind a board, whose codes are m/s² on the wire, whatever unit the bench file declares a drive in."""
    return device_of(bench, drive_unit="mps2")


def recorded_device_of(bench: Bench, record: "Capture") -> settings.Device:
    """The device as a record shows it: with the record's noise and its drive's unit. A component of demodulated streams
    has the density of the declared noise, up to half of the streams' rate.

    Raises InputError as `device_of`, and where the bench file does not tell what a volt of that drive does.
    """
    gain, rate_Hz = record.noise_gain, record.tick_rate_Hz
    if record.carrier_Hz is not None:
        gain *= math.sqrt(2.0 * rate_Hz / bench.device.sample_rate_Hz)
    device = device_of(bench, gain, record.drive_unit if record.has_drive else None)
    return device if record.carrier_Hz is None else replace(device, sample_rate=rate_Hz)


def resonator_of(bench: Bench) -> Resonator:
    """The declared device of which the envelope of a ring-down was recorded."""
    device, spread = bench.device, bench.observer.initial_sd
    damping = device.damping_per_s[0]
    declared = _declared(bench, 1.0, bench.device.drive.unit)
    if device.sense.is_in_decibels:
        declared = replace(declared, sense_unit="dB")  # of differences of levels, whatever 0 dB is
    return Resonator(declared, (damping, spread.damping * damping), 0.5 * spread.stiffness, device.sense.noise_V)


def _declared(bench: Bench, noise_gain: float, drive_unit: DriveUnit) -> settings.Device:
    device = bench.device
    mps2_per_unit = device.drive_mps2_per(drive_unit)
    if mps2_per_unit is None:
        raise InputError(
            f'{device.name}: a drive in V, but [device.drive] unit = "{device.drive.unit}" does not tell what a volt '
            'does; set unit = "V" and gain_N_per_V'
        )
    axes, order = device.axes, device.sense.order
    omega0 = math.sqrt(bench.target_stiffness_per_s2)
    interface = device.sense.interface.map(axes, omega0)
    declared = settings.Device(
        sample_rate=device.sample_rate_Hz,
        stiffness=device.stiffness_per_s2,
        damping=device.damping_per_s,
        amplitude=device.amplitude_m,
        sense_gain=tuple(gain * omega0**order for gain in device.sense_gains_V_per_m),
        noise=(noise_gain * device.sense.noise_V * interface.mean_noise(device.amplitude_m),) * axes,
        mass=device.mass_kg,
        drive_gain=float(mps2_per_unit),
        target_stiffness=bench.target_stiffness_per_s2,
        angular_gain=device.calibration.angular_gain,
        sensed=(settings.Sensed(order),) * axes,
        sense_unit=device.sense.unit,
        interface=interface,
    )
    return replace(declared, own=own_effects(bench, declared))


def observer_settings_of(bench: Bench) -> settings.ObserverSettings:
    """Variant, gain, initial value and noise."""
    observer, mass = bench.observer, bench.device.mass_kg
    given, spread, noise = observer.initial, observer.initial_sd, observer.process_noise
    initial = {"rate": given.rate_rad_s} if bench.device.axes == 2 else {}
    for names, values, unit in (
        (("x", "y"), given.position_m, 1.0),
        (("vx", "vy"), given.velocity_mps, 1.0),
        (("phi_x", "phi_y"), given.offset_V, 1.0),
        (("kxx", "kyy", "kxy"), given.stiffness_N_per_m, mass),
        (("dxx", "dyy", "dxy"), given.damping_N_s_per_m, mass),
    ):
        initial |= {name: value / unit for name, value in zip(names, values or (), strict=False)}
    drive_noise = bench.device.drive.noise_mps2_per_rtHz
    return settings.ObserverSettings(
        effects=included(bench),
        reference=bench.loop.settle_s,
        by_loops=bench.observer.plugin == PLUGIN,
        open_loop=bench.device.axes == 2 and formula_of(bench).kind != "pattern",
        variant=settings.Variant(observer.variant),
        gain=settings.Gain(observer.gain),
        memory=bench.memory_s,
        acquisition=observer.acquisition_s,
        initial=initial,
        spread=settings.Spread(
            position=spread.position,
            velocity=spread.velocity,
            offset=bench.offset_sd_V,
            rate=spread.rate_rad_s,
            stiffness=spread.stiffness,
            damping=spread.damping,
            drive_gain=spread.drive_gain if not bench.device.drive.gain_known else 0.0,
        ),
        process_noise=settings.ProcessNoise(
            force=math.hypot(noise.force_mps2_per_rtHz, drive_noise),
            rate=noise.rate_rad_s_per_rts,
            offset=noise.offset_V_per_rts,
            stiffness=noise.stiffness_per_rts,
            damping=noise.damping_per_rts,
        ),
    )


def controller_settings_of(bench: Bench, identity: Identity) -> settings.ControllerSettings:
    """Control law and holds, with the board's own codes and latency."""
    controller = bench.controller
    return settings.ControllerSettings(
        latency=identity.latency_ticks,
        force_quantum=identity.drive_scale_mps2,
        force_limit=drive_limit_of(bench, identity) * identity.drive_scale_mps2,
        sense_quantum=identity.sense_scale_V,
        energy_gain=controller.energy_gain,
        quadrature_gain=controller.quadrature_gain,
        virtual_rotation=controller.virtual_rotation_rad_s,
        virtual_reversal=bench.virtual_reversal_s,
        dither=controller.dither_mps2,
        dither_seed=bench.loop.seed,
        modulation=controller.amplitude_modulation,
        modulation_rate=2.0 * math.pi * controller.modulation_Hz,
    )


def board_filter_of(bench: Bench) -> BoardFilter:
    """What the board is to make two signals of each axis by, in gain mode."""
    step_rad = math.sqrt(bench.target_stiffness_per_s2) / bench.device.sample_rate_Hz
    if bench.loop.filter == "luenberger":
        return luenberger(step_rad)
    return pair(min(max(round(0.5 * math.pi / step_rad), 1), int(SPEC.registers["FILTER_DELAY"].maximum)))


def board_dither_of(bench: Bench, identity: Identity) -> tuple[int, int]:
    """Amplitude in drive codes and start of the dither that the board itself adds in gain mode."""
    amplitude = bench.controller.dither_mps2 if bench.controller.enabled else 0.0
    codes = min(_codes(Fraction(amplitude), identity), drive_limit_of(bench, identity))
    return codes, (bench.loop.seed or 0) % 0xFFFFFFFF + 1


def drive_limit_of(bench: Bench, identity: Identity) -> int:
    """Largest drive code the board is to apply, whose force is not beyond the limit that is declared."""
    return min(_codes(bench.drive_limit_mps2, identity), (1 << (identity.drive_bits - 1)) - 1)


def _codes(force_mps2: Fraction, identity: Identity) -> int:
    """Whole drive codes of a force per mass, rounded towards zero: never more force than asked for."""
    return int(force_mps2 / Fraction(identity.drive_scale_mps2))


def require_agreement(bench: Bench, identity: Identity, link: str) -> None:
    """InputError naming the first thing that bench file and board say differently."""
    device = bench.device
    if identity.axes != device.axes:
        raise InputError(
            f"{link}: the board has {identity.axes} axes, [device] axes says {device.axes}; "
            "correct the bench file, or the board's IDENTITY"
        )
    if not math.isclose(identity.tick_rate_Hz, device.sample_rate_Hz, rel_tol=1e-6):
        raise InputError(
            f"{link}: the board samples at {identity.tick_rate_Hz:g} Hz, [device] sample_rate_Hz says "
            f"{device.sample_rate_Hz:g}; correct the bench file, or the board's IDENTITY"
        )


Kind = Literal["pattern", "rate", "none"]


class Formula(NamedTuple):
    """kind: formula (11) on the pattern, the integrated rate, or no angle at all; why: one line."""

    kind: Kind
    why: str


def formula_of(bench: Bench) -> Formula:
    """Formula (11) of the source wherever the pattern turns with the board: under the control law, which makes an ideal
    oscillator of the device, and in open loop where the declared gyro is one by itself.

    Elsewhere the pattern turns by itself.  With the parameters known (the observer of 7 states) the integrated rate is
    an angle all the same; estimated beside it, they take their part of it, and there is none.  A plug-in sees to
    its angle itself.
    """
    if bench.device.axes == 1:
        return Formula("none", "a single axis has no angle")
    if bench.observer.plugin is not None:
        own = "the formula of the loops" if bench.observer.plugin == PLUGIN else "the plug-in's own formula"
        if bench.controller.enabled:
            return Formula("pattern", own)
        return Formula("rate", f"{own}, without control")
    if bench.controller.enabled:
        return Formula(
            "pattern", "formula (11), minus the rotation by drive forces: the control law makes the gyro isotropic"
        )
    if not (flaw := _flaw(bench)):
        return Formula("pattern", "formula (11): the declared gyro is isotropic and undamped, so no control is needed")
    if bench.observer.variant == "sense":
        return Formula("rate", f"the integrated rate, not formula (11): without control {flaw}")
    return Formula("none", f"without control {flaw}")


def _flaw(bench: Bench) -> str:
    """Why the declared gyro is no ideal one, "" where it is: over the run its pattern stays slender and its energy
    where [limits] want them, with no help of a control law.
    """
    (kxx, kyy, kxy), damping = bench.device.stiffness_per_s2, bench.device.damping_per_s
    apart = math.hypot(kxx - kyy, 2.0 * kxy) / (2.0 * math.sqrt(bench.target_stiffness_per_s2))
    seconds, limits = bench.loop.duration_s, bench.limits
    if 0.5 * apart * seconds > limits.quadrature:  # what a line along neither mode has become by then
        return f"its modes, {quantity(apart / (2.0 * math.pi), 'Hz', 2)} apart, rotate the pattern"
    lost = -math.expm1(-max(damping[:2]) * seconds)
    if lost > limits.energy_error:
        return f"its damping, which takes {percent(lost)} of the energy, may rotate the pattern"
    return ""
