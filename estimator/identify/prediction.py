"""What an observer and its control loop will reach on an identified device, before anything is armed.

The core plays its own model: the declared device, the drives that the control law asks for, the latency.  Without noise
the observer's covariance C along that record is the stationary one of its estimates; two records that differ by a small
step of the rate give the linear response of rate and angle; records in which the drive acts later than it says give the
delay that the loop bears.
"""

import math
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator.core.experiment import MOST_LATE, Plan, experiment_block
from estimator.observer import Estimates, Observer
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, ObserverSettings

_SETTLE, _SPAN = 3.0, 4.0  # memories
_PARTS = 16  # of the span, at whose ends the covariance is read
_SEED = 20  # of the noise beside which a margin is found
_STEP = 1e-3  # rad/s: small beside any noise, so that the response is linear
_HALF_POWER = math.sqrt(0.5)
_FREQUENCIES = 400
_HALVINGS = 3  # of the delays between which the limit is passed
_LEAST_SAMPLES = 4.0  # of a cycle: an observer needs no fewer


class Prediction(NamedTuple):
    """angle_noise_rad: rms of the reported angle; angle_random_walk_rad_per_rts: as it wanders beside that;
    angle_bandwidth_Hz, rate_bandwidth_Hz: −3 dB, inf beyond half of the frequency of the vibration;
    delay_margin_s: by how much later than declared the drive may act, None where no force is answered sample by sample;
    margin_open: whether that is only what was tried.
    """

    angle_noise_rad: float
    angle_random_walk_rad_per_rts: float
    angle_bandwidth_Hz: float
    rate_bandwidth_Hz: float
    delay_margin_s: float | None
    margin_open: bool


class Holding(NamedTuple):
    """Energy error and quadrature up to which the angle counts as valid; the share of a run in which it may not."""

    energy_error: float
    quadrature: float
    invalid: float


class Loop:
    """An observer and its control law about the device as declared."""

    def __init__(self, device: Device, settings: ObserverSettings, law: ControllerSettings) -> None:
        self._device, self._law = device, law
        # Once a cycle: within it the angle follows a rate by steps.
        self._every = max(round(2.0 * math.pi * device.sample_rate / math.sqrt(device.target)), 1)
        self._settings = replace(settings, effects={}, reference=0.0)
        memory = settings.memory * device.sample_rate
        self._settled, self._span = int(_SETTLE * memory), int(_SPAN * memory)

    def prediction(self, holding: Holding | None) -> Prediction:
        """All of it; holding: None for a loop that the board closes."""
        samples = self._settled + self._span
        still = self._played(np.zeros(samples))
        noise, wander = self._noise(*still)
        rates = np.zeros(samples)
        rates[self._settled :] = _STEP
        pair = [self._observer().run(*record, every=self._every) for record in (still, self._played(rates))]
        angle, rate = self._bandwidths(*pair)
        margin, is_open = (None, False) if holding is None else self._margin(holding)
        return Prediction(noise, wander, angle, rate, margin, is_open)

    def _observer(self) -> Observer:
        observer = Observer(self._device, self._settings, self._law)
        observer.x[:4] = 1.0, 0.0, 0.0, 0.0
        return observer

    def _played(self, rates: Array, late: float = 0.0, *, noisy: bool = False) -> tuple[Array, Array]:
        """Sense voltages (n, 2) and drives (n, 2, 1) of the closed loop; rates in rad/s, late in samples."""
        loop, samples = self._observer(), len(rates)
        sensed, drive, noise = (np.zeros((samples, 2)) for _ in range(3))
        if noisy:
            noise += np.random.default_rng(_SEED).standard_normal((samples, 2)) * np.sqrt(loop.sense_noise)
        plan = Plan(rates / loop.scaling.omega0, np.ones(samples), noise, late)
        experiment_block(loop, loop.x, plan, sensed, drive)
        return sensed * loop.volts, (drive * loop.scaling.drive)[:, :, None]

    def _noise(self, sense: Array, drive: Array) -> tuple[float, float]:
        """Of the reported angle [rad] and its random walk [rad/√s], of the covariance that the estimates have.

        The angle's error since an instant is that of the pattern there and now, and what has added up between.
        """
        observer = self._observer()
        observer.rest_constants()
        spans = np.linspace(self._settled, len(sense), _PARTS + 1).astype(int)
        observer.run(sense[: spans[0]], drive[: spans[0]], every=spans[0])
        observer.refer_angle()
        turns = 1.0 / self._device.angular_gain
        own, grown = [turns**2 * observer.pattern_variance], [0.0]
        for begin, end in pairwise(spans.tolist()):
            last = observer.run(sense[begin:end], drive[begin:end], every=end - begin)
            own.append(turns**2 * observer.pattern_variance)
            grown.append(float(last.angle_deviation[-1]) ** 2 - own[-1])
        late = slice(_PARTS // 2, None)
        slope = float(np.polyfit(spans[late] / self._device.sample_rate, grown[late], 1)[0])
        return math.sqrt(np.mean(own)), math.sqrt(max(slope, 0.0))

    def _bandwidths(self, still: Estimates, stepped: Estimates) -> tuple[float, float]:
        """−3 dB of angle and rate, by their responses to a step of the rate."""
        rows = slice(int(np.searchsorted(still.index, self._settled)), None)
        step_s = self._every / self._device.sample_rate
        rate = (stepped.of("rate") - still.of("rate"))[rows] / _STEP
        angle = (stepped.angle - still.angle)[still.index[rows]] / _STEP
        slope = np.diff(angle, prepend=0.0) / step_s
        return minus_3_dB(slope, step_s), minus_3_dB(rate, step_s)

    def _margin(self, holding: Holding) -> tuple[float, bool]:
        """Delay [s] at which amplitude and quadrature are no longer held, and whether none was found."""
        low, high = 0.0, 1.0
        shares = {low: self.beyond(low, holding)}
        if shares[low] >= 1.0:
            return 0.0, False
        while (share := self.beyond(high, holding)) < 1.0:
            if high == MOST_LATE:
                return high / self._device.sample_rate, True
            low, high, shares = high, min(2.0 * high, float(MOST_LATE)), {high: share}
        shares[high] = share
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            shares[middle] = self.beyond(middle, holding)
            low, high = (middle, high) if shares[middle] < 1.0 else (low, middle)
        crossing = 0.5
        if shares[low] > 0.0 and math.isfinite(shares[high]):
            crossing = -math.log(shares[low]) / math.log(shares[high] / shares[low])
        return (low + crossing * (high - low)) / self._device.sample_rate, False

    def beyond(self, late: float, holding: Holding) -> float:
        """What share of its limit energy error or quadrature has, in all but `holding.invalid` of the time, where the
        drive acts so many samples late; inf where the motion is lost.

        With noise: beside it the observer sees less of what is wrong, and forgets no faster.
        """
        record = self._played(np.zeros(self._settled + self._span), late, noisy=True)
        with np.errstate(all="ignore"):
            found = self._observer().run(*record, every=self._every)
        rows = found.index[found.index >= self._settled]
        return share_of_limit(found.energy_ratio[rows], found.quadrature_ratio[rows], holding)


def share_of_limit(energy: Array, quadrature: Array, holding: Holding) -> float:
    """What share of its limit energy error or quadrature (n,) has, in all but `holding.invalid` of the rows; inf
    without any.
    """
    if not len(energy):
        return math.inf
    worst = np.maximum(np.abs(energy - 1.0) / holding.energy_error, np.abs(quadrature) / holding.quadrature)
    return float(np.quantile(np.where(np.isfinite(worst), worst, np.inf), 1.0 - holding.invalid, method="lower"))


def minus_3_dB(step: Array, step_s: float) -> float:
    """Frequency [Hz] above which a response to a step (n,) stays below −3 dB; inf where that is beyond half of the rate
    of its rows.
    """
    impulse = np.diff(step, prepend=0.0)
    hertz = np.geomspace(1.0 / (len(step) * step_s), 0.5 / step_s, _FREQUENCIES)
    gain = np.abs(np.exp(-2j * np.pi * step_s * np.outer(hertz, np.arange(len(step)))) @ impulse)
    above = np.flatnonzero(gain >= _HALF_POWER * abs(float(np.mean(step[len(step) // 2 :]))))
    last = int(above[-1]) if len(above) else 0
    if last == len(hertz) - 1:
        return math.inf
    share = np.log(gain[last] / _HALF_POWER) / np.log(gain[last] / gain[last + 1])
    return float(hertz[last] * (hertz[last + 1] / hertz[last]) ** np.clip(share, 0.0, 1.0))


LATE_TICK = "a tick within the delay margin"
"""What a drive that acts one sample late needs."""


def rate_needed_Hz(omega: float, found: Prediction) -> dict[str, float]:
    """Loop rates [Hz], by what needs them, of a device that vibrates at `omega` [rad/s]: samples of a cycle, a drive
    that acts one sample late, both sides of the band.
    """
    needed = {"four samples of a cycle": _LEAST_SAMPLES * omega / (2.0 * math.pi)}
    if found.delay_margin_s:
        needed[LATE_TICK] = 1.0 / found.delay_margin_s
    if math.isfinite(found.angle_bandwidth_Hz):
        needed["twice the bandwidth of the angle"] = 2.0 * found.angle_bandwidth_Hz
    return needed
