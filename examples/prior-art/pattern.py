"""The angle read off the signals, without an observer: three methods that the patent calls prior art.

Friedland & Hutton, "Theory and error analysis of vibrating-member gyroscope", IEEE Trans. Automatic Control 23(4),
545–556, 1978.  That paper's error analysis says what anisotropy and the forces of a control do to the pattern.  Its
method has no means to know them: only the virtual rotation is taken off.

    [observer]
    plugin = "pattern.py:OrbitalElements"
"""

import math
from collections import deque

import numpy as np

import hil

Pair = tuple[float, float]


class RawFormula:
    """Formula (11) sample by sample,

        tan 2θ = 2 (k x y + ẋẏ) / (k (x² − y²) + ẋ² − ẏ²).

    x, y are the sense voltages over their gain.  The velocities are central differences; that a difference of a sine
    over two samples is too small by sin(ω0 h)/ω0 h is put right.  A sense offset Φ makes the angle ripple at the
    frequency of the vibration, by Φ over the amplitude.
    """

    cycles = 0.0
    """Periods of the target oscillator over which numerator and denominator are averaged."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        self.reading = Reading(device, delay_cycles=0.5 * self.cycles, over_cycles=self.cycles or 1.0)
        self.k = device.target_stiffness_per_s2
        self.per_s = math.sqrt(self.k) / (2.0 * math.sin(math.sqrt(self.k) / device.sample_rate_Hz))
        self.position = deque([(math.nan, math.nan)] * 3, maxlen=3)
        self.terms = Window(max(round(self.cycles * self.reading.samples_per_cycle), 1))

    def observe(self, sense: Pair, applied: Pair, imposed: float) -> hil.Estimate:
        """As `hil.Observer`."""
        self.position.append(self.reading.displacement(sense))
        (x0, y0), (x, y), (x2, y2) = self.position
        vx, vy = self.per_s * (x2 - x0), self.per_s * (y2 - y0)
        across, along = 2.0 * (self.k * x * y + vx * vy), self.k * (x * x - y * y) + vx * vx - vy * vy
        if self.cycles:
            across, along = self.terms.with_(across, along).sum(axis=0)
        return self.reading.estimate(0.5 * math.atan2(across, along), imposed)


class AveragedFormula(RawFormula):
    """The same, averaged over a cycle.  That takes the ripple away but for Φ² over the amplitude squared."""

    cycles = 1.0


class OrbitalElements:
    """The elements of the ellipse that the mass goes through: half axes a and b, inclination θ, phase.

    They are constants of the ideal motion but for θ̇ = −Ω, and what demodulation at the frequency of the vibration
    leaves.  With the phasors X and Y of both axes, against any reference phase,

        tan 2θ = 2 Re(X Y*) / (|X|² − |Y|²).

    The low-pass is a Hann window of four periods of the target oscillator.  It has its zeros where an offset and the
    image at twice the frequency stand, so that neither gets into the elements.
    """

    def __init__(self, device: hil.DeclaredDevice) -> None:
        self.reading = Reading(device, delay_cycles=2.0, over_cycles=2.0)
        half = self.reading.delay
        step = math.sqrt(device.target_stiffness_per_s2) / device.sample_rate_Hz
        hann = np.hanning(2 * half + 3)[1:-1]
        self.window = 2.0 * hann / hann.sum() * np.exp(-1j * step * np.arange(2 * half + 1))
        self.position = Window(2 * half + 1)

    def observe(self, sense: Pair, applied: Pair, imposed: float) -> hil.Estimate:
        """As `hil.Observer`."""
        x, y = self.window @ self.position.with_(*self.reading.displacement(sense))
        double = math.atan2(2.0 * (x * y.conjugate()).real, abs(x) ** 2 - abs(y) ** 2)
        return self.reading.estimate(0.5 * double, imposed)


class Window:
    """The last `length` pairs of numbers, NaN where there were none yet, in one piece of memory."""

    def __init__(self, length: int) -> None:
        self.length, self.end = length, length
        self.rows = np.full((8 * length, 2), math.nan)

    def with_(self, first: float, second: float) -> np.ndarray:
        """Take a pair in; all of them (length, 2), in order."""
        if self.end == len(self.rows):
            self.rows[: self.length] = self.rows[-self.length :]
            self.end = self.length
        self.rows[self.end] = first, second
        self.end += 1
        return self.rows[self.end - self.length : self.end]


class Reading:
    """The angle of the board from that of the pattern, in the middle of some samples, carried on to the last of them.

    delay_cycles: from the middle to the last sample; over_cycles: over which its slope is taken.
    """

    def __init__(self, device: hil.DeclaredDevice, *, delay_cycles: float, over_cycles: float) -> None:
        omega = math.sqrt(device.target_stiffness_per_s2)
        self.step_s = 1.0 / device.sample_rate_Hz
        self.samples_per_cycle = 2.0 * math.pi * device.sample_rate_Hz / omega
        self.delay = round(delay_cycles * self.samples_per_cycle)
        # A velocity has the ellipse of the displacement a quarter of a cycle earlier.
        self.volts_per_m = [gain * omega**device.sense_order for gain in device.sense_gain_V_per_m]
        self.gain = device.angular_gain
        self.imposed = deque([0.0] * (self.delay + 2), maxlen=self.delay + 2)  # rad, of the pattern
        self.known: deque[float] = deque(maxlen=1 + round(over_cycles * self.samples_per_cycle))  # rad, of the board
        self.last = [(0.0, 0.0)] * 2  # m
        self.zero: float | None = None
        self.angle = self.rate = 0.0

    def displacement(self, sense: Pair) -> Pair:
        """Volts over the known gain [m], offset and noise still in them; NaN where lost."""
        x, y = (volts / gain for volts, gain in zip(sense, self.volts_per_m, strict=True))
        if not math.isnan(x + y):
            self.last = [self.last[1], (x, y)]
        return x, y

    def estimate(self, theta: float, imposed: float) -> hil.Estimate:
        """After a sample: theta of the pattern [rad] in the middle, NaN where it is not known; imposed as `observe`
        has it.  Without theta the board is taken to turn on as it did.
        """
        self.imposed.append(self.imposed[-1] + imposed * self.step_s)
        if math.isnan(theta):
            self.known.clear()
            self.angle += self.rate * self.step_s
        else:
            self._take(-(theta + self.imposed[0]) / self.gain)
        (x0, y0), (x, y) = self.last
        return hil.Estimate(x, (x - x0) / self.step_s, y, (y - y0) / self.step_s, self.rate, self.angle)

    def _take(self, angle: float) -> None:
        """The board's angle in the middle, modulo half a turn of the pattern."""
        if self.zero is None:
            self.zero = angle
        late = self.delay * self.step_s
        half_turn, expected = math.pi / self.gain, self.angle - late * self.rate
        angle -= self.zero
        angle += half_turn * round((expected - angle) / half_turn)
        self.known.append(angle)
        if len(self.known) == self.known.maxlen:
            self.rate = (angle - self.known[0]) / ((len(self.known) - 1) * self.step_s)
        self.angle = angle + late * self.rate
