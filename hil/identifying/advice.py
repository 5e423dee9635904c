"""What the proposed settings will reach on a board that was identified, in figures and in a sentence each."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from estimator.identify.prediction import LATE_TICK, Holding, Loop, Prediction, rate_needed_Hz
from estimator.settings import ObserverSettings
from hil.bench import Bench
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.numbers import quantity, significant
from hil.wire.messages import Identity

_RAD_PER_RTS = math.degrees(60.0)  # ° per √h
_TRIED = 2.0  # times of a setting, to see whether a wish hangs on it
_WORTH = 1.05  # times, from which on it does


class Wishes(NamedTuple):
    """What the user asks for: largest noise of the angle [rad], least bandwidth of the angle [Hz]."""

    angle_noise_rad: float | None = None
    bandwidth_Hz: float | None = None


class Advice(NamedTuple):
    """A prediction; what needs which loop rate [Hz] beside the board's; wishes that are not reached, each in a line."""

    prediction: Prediction
    needed_Hz: dict[str, float]
    rate_Hz: float
    omega: float
    missed: tuple[str, ...] = ()

    @property
    def loop_rate_Hz(self) -> float:
        """The rate that all of it needs."""
        return max(self.needed_Hz.values())

    def as_json(self) -> dict[str, Any]:
        """In JSON values; a bandwidth beyond half of the resonance is null."""
        told = self.prediction._asdict()
        finite = {name: None if isinstance(one, float) and math.isinf(one) else one for name, one in told.items()}
        rates = {"loop_rate_needed_Hz": self.loop_rate_Hz, "loop_rate_Hz": self.rate_Hz}
        return {**finite, **rates, "sentences": list(self.sentences), "missed": list(self.missed)}

    @property
    def sentences(self) -> tuple[str, ...]:
        """A plain one for each figure."""
        told = self.prediction
        walk = told.angle_random_walk_rad_per_rts
        ratio = self.rate_Hz / self.loop_rate_Hz
        why = max(self.needed_Hz, key=lambda name: self.needed_Hz[name])
        return (
            f"Noise of the angle at a constant rate: {quantity(told.angle_noise_rad, 'rad')} rms.",
            f"Angle random walk: {quantity(walk, 'rad/√s')} ({significant(walk * _RAD_PER_RTS, 3)} °/√h).",
            f"Bandwidth, −3 dB: angle {_hertz(told.angle_bandwidth_Hz)}, rate {_hertz(told.rate_bandwidth_Hz)}.",
            _margin(told, self.omega, self.rate_Hz),
            f"Loop rate: {why} needs {quantity(self.loop_rate_Hz, 'Hz')}; the board has "
            f"{quantity(self.rate_Hz, 'Hz')}, {ratio:.3g} × that{_short(why) if ratio < 1.0 else ''}.",
        )


def _short(why: str) -> str:
    """What a lower rate than that means."""
    return ": the loop holds while no answer is a tick late" if why == LATE_TICK else ""


def predicted(bench: Bench, identity: Identity) -> Prediction:
    """Of a bench on its board."""
    return _loop(bench, identity, observer_settings_of(bench)).prediction(_holding(bench))


def advice_of(bench: Bench, identity: Identity, wishes: Wishes) -> Advice:
    """The same, with the loop rate that it needs, and what stands against a wish."""
    told = predicted(bench, identity)
    omega = float(np.sqrt(bench.target_stiffness_per_s2))
    advice = Advice(told, rate_needed_Hz(omega, told), identity.tick_rate_Hz, omega)
    return advice._replace(missed=_missed(bench, identity, told, wishes))


def _loop(bench: Bench, identity: Identity, settings: ObserverSettings) -> Loop:
    law = controller_settings_of(bench, identity)
    return Loop(board_device_of(bench), settings, law)


def _holding(bench: Bench) -> Holding | None:
    if bench.loop.in_blocks:
        return None
    limits = bench.limits
    return Holding(limits.energy_error, limits.quadrature, limits.invalid_fraction)


def _missed(bench: Bench, identity: Identity, told: Prediction, wishes: Wishes) -> tuple[str, ...]:
    """Wishes that are not reached, each with the setting on which that hangs most, and what it costs."""
    lines = []
    for what, wish, got, unit in (
        ("angle noise", wishes.angle_noise_rad, told.angle_noise_rad, "rad"),
        ("bandwidth", wishes.bandwidth_Hz, told.angle_bandwidth_Hz, "Hz"),
    ):
        wants_less = unit == "rad"
        if wish is None or (got <= wish if wants_less else got >= wish):
            continue
        key, other = _limiting(bench, identity, told, wants_less=wants_less)
        asked = f"{what} of {quantity(wish, unit)} is not reached, {quantity(got, unit)} is predicted"
        lines.append(f"{asked}: {_cure(key, other, wants_less=wants_less)}")
    return tuple(lines)


def _limiting(bench: Bench, identity: Identity, told: Prediction, *, wants_less: bool) -> tuple[str, Prediction | None]:
    """The key that gains most, changed so many times, with what is predicted then; the noise where none does."""
    settings, times = observer_settings_of(bench), 1.0 / _TRIED if wants_less else _TRIED
    noise = settings.process_noise
    tried = {
        "[observer.process_noise] rate_rad_s_per_rts": replace(
            settings, process_noise=replace(noise, rate=noise.rate * times)
        ),
        "[observer] memory_s": replace(settings, memory=settings.memory / times),
    }
    found = {key: _loop(bench, identity, one).prediction(None) for key, one in tried.items()}

    def gained(one: Prediction) -> float:
        noises, bands = told.angle_noise_rad / one.angle_noise_rad, one.angle_bandwidth_Hz / told.angle_bandwidth_Hz
        return noises if wants_less else bands

    best = max(found, key=lambda key: gained(found[key]))
    if gained(found[best]) < _WORTH:
        return "[device.sense] noise_V" if wants_less else "[device] sample_rate_Hz", None
    return best, found[best]


def _cure(key: str, other: Prediction | None, *, wants_less: bool) -> str:
    if other is None:
        return f"{key} limits it, which no setting changes"
    less = wants_less == (key != "[observer] memory_s")
    return (
        f"{key} limits it; {'half' if less else 'twice'} of it gives {quantity(other.angle_noise_rad, 'rad')} and "
        f"{_hertz(other.angle_bandwidth_Hz)}"
    )


def _hertz(value: float) -> str:
    return "beyond half of the resonance" if math.isinf(value) else quantity(value, "Hz")


def _margin(told: Prediction, omega: float, rate_Hz: float) -> str:
    late = told.delay_margin_s
    if late is None:
        return "Delay margin: not predicted in gain mode; the board closes the loop there."
    degrees, ticks = significant(math.degrees(late * omega), 3), significant(late * rate_Hz, 3)
    most = "at least " if told.margin_open else ""
    return (
        f"Delay margin: the drive may act {most}{quantity(late, 's')} ({ticks} ticks, {degrees}° at the resonance) "
        "later than IDENTITY says; beyond that amplitude or quadrature leaves [limits]."
    )
