"""From a sensor's counter to sample numbers: how far apart datagrams are, and how many are missing between two.

Counters count datagrams, or samples inside the sensor of which a datagram is sent every few, or are a clock; the median
difference tells. Whether whole turns of the counter are missing, only the host's clock can tell: when far more time
has passed between two batches than the samples in the second account for. So a batch must hold all that had arrived.
Of a count that is ours, since the sensor sends none, it tells single samples, of gaps longer than a line's buffers.
"""

from itertools import pairwise
from statistics import median_low

from hil.sensors.adapter import Sample

LEARN_SAMPLES, LEARN_S = 32, 0.5
"""Datagrams, and their time, from which step and rate are learned."""
SLOW_SAMPLES, SLOW_S = 6, 1.5
"""The same of a slow sensor."""

_NEAR = 0.1  # of a rate the sensor can be set to; any other is triggered from outside
_NEAR_BY_CLOCK = 0.01  # the same where the sensor's own clock told the rate
_LATE_S = 0.05  # between two looks of the host that a line's buffers account for
_WIDE = 1 << 15  # values of a counter that never turns in a gap: going back, it began anew


class TickCounter:
    """Numbers the samples of one stream, whose counter has `size` values and which may come at the `rates_Hz`; of a
    counter that is a clock, counts a second are `counter_Hz`. rate_Hz: where it is known and the host's clock tells
    nothing, as of a file; is_ours: it counts what was heard, as the sensor sends no counter.

    Attributes:
        step: counts of the counter per sample; 0 until it is known.
        sample_rate_Hz: 0 until it is known.
        restarts: how often the counter began anew.
    """

    def __init__(self, size: int, rates_Hz: tuple[float, ...], counter_Hz: float = 0.0,
                 rate_Hz: float | None = None, *, is_ours: bool = False) -> None:  # fmt: skip
        self.step = 0
        self.sample_rate_Hz = 0.0
        self.restarts = 0
        self._size, self._rates_Hz, self._counter_Hz, self._rate_Hz = size, rates_Hz, counter_Hz, rate_Hz
        self._is_ours = is_ours
        self._learning: list[tuple[list[Sample], float]] = []
        self._apart: float = 0.0
        self._counter: int | None = None
        self._came_s = 0.0
        self._tick = 0

    def number(self, batch: list[Sample], now_s: float) -> list[tuple[int, Sample]]:
        """(tick, sample) of all whose tick is known by now; `now_s` is when the batch came. The first tick is 0."""
        if not batch:
            return []
        if self.step:
            return self._number(batch, now_s)
        self._learning.append((batch, now_s))
        first, counts = len(self._learning[0][0]), [s.counter for samples, _ in self._learning for s in samples]
        elapsed_s = now_s - self._learning[0][1]
        by_itself = bool(self._counter_Hz or self._rate_Hz)
        heard = len(counts) - (0 if by_itself else first)
        if not any(heard >= n and (elapsed_s >= s or by_itself) for n, s in
                   ((LEARN_SAMPLES, LEARN_S), (SLOW_SAMPLES, SLOW_S))):  # fmt: skip
            return []
        steps = [(b - a) % self._size or self._size for a, b in pairwise(counts)]
        self.step = median_low(steps)
        if self._rate_Hz:
            self.sample_rate_Hz = self._rate_Hz
        elif self._counter_Hz:
            sound = [step for step in steps if step < 1.5 * self.step]
            self.sample_rate_Hz = self._near(self._counter_Hz * len(sound) / sum(sound), _NEAR_BY_CLOCK)
        else:
            self.sample_rate_Hz = self._near(sum(steps[first - 1 :]) / self.step / elapsed_s, _NEAR)
        # a clock's counts may fall between: 12 and 13 of 10 kHz at 800 samples a second
        self._apart = self._counter_Hz / self.sample_rate_Hz if self._counter_Hz and not self._rate_Hz else self.step
        return [numbered for samples, came_s in self._learning for numbered in self._number(samples, came_s)]

    def _near(self, rate_Hz: float, share: float) -> float:
        nearest = min(self._rates_Hz, key=lambda rate: abs(rate - rate_Hz), default=rate_Hz)
        return nearest if abs(rate_Hz / nearest - 1.0) <= share else rate_Hz

    def _number(self, batch: list[Sample], now_s: float) -> list[tuple[int, Sample]]:
        numbered = []
        missing = self._missing(batch, now_s)
        for sample in batch:
            if self._counter is not None:
                passed: float = (sample.counter - self._counter) % self._size + missing
                if passed > self._size // 2 and self._size >= _WIDE:
                    self.restarts += 1
                    passed = max(round((now_s - self._came_s) * self.sample_rate_Hz) - len(batch) + 1, 1) * self._apart
                self._tick += max(round(passed / self._apart), 1)
                missing = 0
            self._counter = sample.counter
            numbered.append((self._tick, sample))
        self._came_s = now_s
        return numbered

    def _missing(self, batch: list[Sample], now_s: float) -> int:
        """Counts that the counter does not tell: whole turns of it, of a count of ours every one."""
        if self._counter is None or self._size >= _WIDE or self._rate_Hz:
            return 0
        told = sum((b - a) % self._size for a, b in pairwise([self._counter, *(sample.counter for sample in batch)]))
        counted = (now_s - self._came_s) * self.sample_rate_Hz * self.step
        if counted - told < _LATE_S * self.sample_rate_Hz * self.step:
            return 0
        turn = self.step if self._is_ours else self._size
        return max(round((counted - told) / turn), 0) * turn
