"""Whether the sense channels of a board that streams can be those of the declared device; before it is first driven.

The mass may be at rest or swing, so that a low level is nothing to refuse.  What is refused is a channel that stands
still although its noise should move it, one at the end of its converter, one that sits far from its declared offset,
and one that swings far beyond the declared amplitude.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hil.bench import Bench
from hil.wire.messages import Identity

_STUCK = 50  # equal codes in a row; the noise being half a code or more
_CLIPPED = 0.02  # share of the samples at the end of the converter
_SWING = 3.0  # amplitudes
_OFFSET_SD = 6.0
_MOST = 20_000  # rows that are looked at


class Levels:
    """What the sense channels of the device that `bench` declares can show.

    Attributes:
        rows: how many rows are needed: those of the acquisition, a cycle of the vibration at least.
    """

    def __init__(self, bench: Bench, identity: Identity) -> None:
        device = bench.device
        cycle = math.ceil(device.sample_rate_Hz / device.resonance_Hz) if device.resonance_Hz > 0.0 else _STUCK
        acquired = math.ceil(bench.observer.acquisition_s * identity.tick_rate_Hz)
        self.rows = min(max(acquired, cycle, _STUCK), _MOST)
        self._axes = device.axes
        self._scale_V = identity.sense_scale_V
        self._ends = -(2 ** (identity.sense_bits - 1)), 2 ** (identity.sense_bits - 1) - 1
        self._noise_V = device.sense.noise_V
        self._offset_V = _OFFSET_SD * bench.offset_sd_V
        self._swing_V = bench.swing_V

    def wrong(self, codes: NDArray[np.int64]) -> str:
        """The first thing that is wrong with `codes` (n, 2) of the first rows, one line; "" if nothing is."""
        for axis in range(self._axes):
            if found := self._of(codes[:, axis], "xy"[axis], self._swing_V[axis]):
                return found
        return ""

    def _of(self, codes: NDArray[np.int64], axis: str, swing_V: float) -> str:
        noisy = self._noise_V >= 0.5 * self._scale_V
        if noisy and len(codes) >= _STUCK and (codes == codes[0]).all():
            volts = codes[0] * self._scale_V
            return f"sense {axis} stands still at {volts:.3g} V; check its amplifier, its converter and the cable"
        at_end = float(np.mean((codes <= self._ends[0]) | (codes >= self._ends[1])))
        if at_end > _CLIPPED:
            return f"sense {axis} is at the end of its converter in {at_end:.0%} of the samples; check gain and offset"
        middle_V = float(np.mean(codes)) * self._scale_V
        slack_V = self._offset_V + swing_V + 6.0 * self._noise_V
        if abs(middle_V) > slack_V:
            return (
                f"sense {axis} sits at {middle_V:.3g} V, [device.sense] offset_sd_V and the amplitude allow "
                f"{slack_V:.3g} V; correct them, or check the amplifier"
            )
        peak_V = float(np.abs(codes - np.mean(codes)).max()) * self._scale_V
        allowed_V = _SWING * swing_V + 6.0 * self._noise_V
        if peak_V > allowed_V:
            return (
                f"sense {axis} swings by {peak_V:.3g} V, [device] amplitude_m × gain_V_per_m is {swing_V:.3g} V; "
                "correct them, or check the amplifier"
            )
        return ""
