"""What leaves a host time for its answers, of a board: its latency or its block, and its sample rate."""

from typing import NamedTuple

from hil.numbers import quantity


class Setting(NamedTuple):
    """In force mode `latency_ticks` from a sample to the interval that its answer acts on, and blocks of 1; in gain
    mode `block` samples a SENSE, and latency 0."""

    latency_ticks: int
    block: int
    rate_Hz: float

    @property
    def waits_s(self) -> float:
        """How long the board waits for an answer."""
        return (self.latency_ticks or self.block) / self.rate_Hz

    @property
    def words(self) -> str:
        """As a reader needs it.

        >>> Setting(1, 1, 4000.0).words, Setting(0, 500, 1e5).words
        ('latency 1 tick', 'a block of 500 samples at 100.0\xa0kHz')
        """
        if self.latency_ticks:
            return f"latency {self.latency_ticks} tick{'' if self.latency_ticks == 1 else 's'}"
        return f"a block of {self.block} samples at {quantity(self.rate_Hz, 'Hz', 4)}"
