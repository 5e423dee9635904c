"""Band-pass and decimation of a record, without delay, and what they leave of white noise.

Sense and drive pass the same filter: of what is linear in the motion nothing is lost by it but what lies outside its
band.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_PASSED = 0.4  # of the new rate: what a decimation keeps
_STOPPED_DB = 80.0
_TAIL = 1e-10
"""Of the energy of an impulse's answer: beyond that the ends of a record do not reach.  A drift may be a thousand times
the noise, and what it makes at the ends is to be well below it."""
_MOST = 0.25  # of a record, at each end, that may be lost to them
_PROBE = 1 << 16
_LOWEST = 1e-6  # of the sampling rate: an edge below has no filter in double precision


@dataclass(frozen=True)
class Band:
    """A Butterworth filter run both ways, of what is given of low_Hz and high_Hz, then every `decimate`-th sample."""

    low_Hz: float | None
    high_Hz: float | None
    order: int
    decimate: int
    rate_Hz: float

    def fault(self) -> str | None:
        """What is wrong with it at this rate, beginning with the key."""
        nyquist = 0.5 * self.rate_Hz
        edges = [edge for edge in (self.low_Hz, self.high_Hz) if edge is not None]
        if not edges and self.decimate == 1:
            return "low_Hz: nothing to do; give low_Hz, high_Hz, decimate or several of them"
        if len(edges) == 2 and edges[0] >= edges[1]:
            return f"high_Hz: {edges[1]:g} Hz is not above low_Hz; exchange them"
        passed = _PASSED * self.rate_Hz / self.decimate
        for key, edge in (("low_Hz", self.low_Hz), ("high_Hz", self.high_Hz)):
            if edge is not None and edge < _LOWEST * self.rate_Hz:
                return f"{key}: {edge:g} Hz is below {_LOWEST * self.rate_Hz:g} Hz, a millionth of the sampling rate"
            if edge is not None and edge >= nyquist:
                return f"{key}: {edge:g} Hz is not below half the sampling rate of {self.rate_Hz:g} Hz"
            if edge is not None and self.decimate > 1 and edge > passed:
                return f"{key}: {edge:g} Hz is beyond the {passed:g} Hz that decimate = {self.decimate} leaves"
        return None

    @property
    def rate_after_Hz(self) -> float:
        return self.rate_Hz / self.decimate

    def filtered(self, values: Floats) -> Floats:
        """The series (n,) behind the filter, at its own rate still."""
        from scipy.signal import butter, oaconvolve, sosfiltfilt  # scipy.signal takes half a second to load

        edges = [edge for edge in (self.low_Hz, self.high_Hz) if edge is not None]
        if edges:
            kind = "bandpass" if len(edges) == 2 else "highpass" if self.low_Hz is not None else "lowpass"
            sections = butter(self.order, edges if len(edges) == 2 else edges[0], kind, fs=self.rate_Hz, output="sos")
            values = sosfiltfilt(sections, values, padlen=min(len(values) - 1, 3 * self._span()))
        if self.decimate > 1:
            taps = self._taps()
            half = len(taps) // 2
            ends = np.concatenate(
                [2 * values[0] - values[half:0:-1], values, 2 * values[-1] - values[-2 : -half - 2 : -1]]
            )
            values = oaconvolve(ends, taps, mode="valid")
        return np.asarray(values, dtype=float)

    def noise_gain(self) -> float:
        """What is left of white noise, rms over rms."""
        return float(np.sqrt(np.sum(self._answer() ** 2)))

    def reach(self) -> int:
        """Rows over which an end of the record is felt."""
        energy = self._answer() ** 2
        middle = len(energy) // 2
        beyond = np.cumsum(energy[middle:][::-1])[::-1]
        small = beyond < _TAIL * energy.sum()
        return int(np.argmax(small)) if small.any() else len(small)  # longer than the probe is longer than most records

    def ends_to_drop(self, rows: int) -> int:
        """Rows to leave out at each end, a multiple of `decimate`. Raises ValueError where too little would be left."""
        drop = -(-self.reach() // self.decimate) * self.decimate
        if drop > _MOST * rows:
            raise ValueError(
                f"[filter] its answer to an impulse lasts {2 * drop / self.rate_Hz:.3g} s, the record "
                f"{rows / self.rate_Hz:.3g} s; widen the band, lower order, or give a longer record"
            )
        return drop

    def of(self, channels: Mapping[str, Floats], passed: Mapping[str, bool]) -> dict[str, Floats]:
        """Each channel behind it, its ends left out; filtered where `passed` says so, else only decimated."""
        rows = len(next(iter(channels.values())))
        drop = self.ends_to_drop(rows)
        kept = slice(drop, rows - drop, self.decimate)
        return {name: (self.filtered(values) if passed[name] else values)[kept] for name, values in channels.items()}

    def _span(self) -> int:
        lowest = self.low_Hz or self.high_Hz or self.rate_Hz
        return max(int(self.order * self.rate_Hz / lowest), 16)

    def _taps(self) -> Floats:
        from scipy.signal import firwin, kaiserord

        width = (1.0 - 2.0 * _PASSED) / self.decimate
        count, beta = kaiserord(_STOPPED_DB, width)
        cutoff = 0.5 * (2.0 * _PASSED + 1.0) / self.decimate
        return np.asarray(firwin(count | 1, cutoff, window=("kaiser", beta)), dtype=float)

    def _answer(self) -> Floats:
        probe = np.zeros(_PROBE + 1)
        probe[_PROBE // 2] = 1.0
        return self.filtered(probe)
