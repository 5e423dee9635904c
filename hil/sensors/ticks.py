"""From a sensor's short counter to sample numbers: how far apart datagrams are, and how many are missing between two.

Counters count datagrams, or samples inside the sensor of which a datagram is sent every few; the most frequent
difference tells. Whether whole turns of the counter are missing, only the host's clock can tell: when far more time
has passed between two batches than the samples in the second account for. So a batch must hold all that had arrived.
"""

from collections import Counter
from itertools import pairwise

from hil.sensors.adapter import Sample

LEARN_SAMPLES, LEARN_S = 32, 0.5
"""Datagrams, and their time, from which step and rate are learned."""

_NEAR = 0.1  # of a rate the sensor can be set to; any other is triggered from outside


class TickCounter:
    """Numbers the samples of one stream, whose counter has `size` values and which may come at the `rates_Hz`.

    Attributes:
        step: counts of the counter per sample; 0 until it is known.
        sample_rate_Hz: 0 until it is known.
    """

    def __init__(self, size: int, rates_Hz: tuple[float, ...]) -> None:
        self.step = 0
        self.sample_rate_Hz = 0.0
        self._size, self._rates_Hz = size, rates_Hz
        self._learning: list[tuple[list[Sample], float]] = []
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
        if len(counts) - first < LEARN_SAMPLES or elapsed_s < LEARN_S:
            return []
        steps = [(b - a) % self._size for a, b in pairwise(counts)]
        (self.step, _), *_ = Counter(step or self._size for step in steps).most_common(1)
        self.sample_rate_Hz = self._near(sum(steps[first - 1 :]) / self.step / elapsed_s)
        return [numbered for samples, came_s in self._learning for numbered in self._number(samples, came_s)]

    def _near(self, rate_Hz: float) -> float:
        nearest = min(self._rates_Hz, key=lambda rate: abs(rate - rate_Hz))
        return nearest if abs(rate_Hz / nearest - 1.0) <= _NEAR else rate_Hz

    def _number(self, batch: list[Sample], now_s: float) -> list[tuple[int, Sample]]:
        numbered = []
        turns = self._missing_turns(batch, now_s)
        for sample in batch:
            if self._counter is not None:
                passed = (sample.counter - self._counter) % self._size + turns * self._size
                self._tick += max(round(passed / self.step), 1)
                turns = 0
            self._counter = sample.counter
            numbered.append((self._tick, sample))
        self._came_s = now_s
        return numbered

    def _missing_turns(self, batch: list[Sample], now_s: float) -> int:
        if self._counter is None:
            return 0
        told = sum((b - a) % self._size for a, b in pairwise([self._counter, *(sample.counter for sample in batch)]))
        counted = (now_s - self._came_s) * self.sample_rate_Hz * self.step
        return max(round((counted - told) / self._size), 0)
