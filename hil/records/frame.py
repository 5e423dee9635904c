"""A stretch of channels as a service sends it and a client draws it: lowest and highest values, in binary (`GYT1`)."""

import struct
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from hil.errors import InputError

_HEAD = struct.Struct("<4sIIIddQ")
_MAGIC = b"GYT1"


@dataclass(frozen=True)
class Frame:
    """Lowest and highest value of each channel (channels, buckets), from bench time `begin_s` on, `step_s` to a bucket
    whose first has the number `first`; equal where a bucket is one sample, not a number where nothing was recorded.
    `id` is that of the subscription it answers.
    """

    begin_s: float
    step_s: float
    first: int
    low: npt.NDArray[np.float32]
    high: npt.NDArray[np.float32]
    id: int = 0

    @property
    def buckets(self) -> int:
        return int(self.low.shape[1])

    @property
    def t_s(self) -> npt.NDArray[np.float64]:
        """Bench time of each bucket's beginning (buckets,)."""
        return np.asarray(self.begin_s + self.step_s * np.arange(self.buckets), np.float64)

    def packed(self, subscription: int = 0) -> bytes:
        """As it is sent: the head, then channel by channel the pairs of lowest and highest, little-endian."""
        count, buckets = self.low.shape
        head = _HEAD.pack(_MAGIC, subscription, count, buckets, self.begin_s, self.step_s, self.first)
        return head + np.stack([self.low, self.high], axis=2).astype("<f4").tobytes()

    @classmethod
    def of(cls, data: bytes) -> Self:
        """A frame as it is sent. Raises InputError where it is none."""
        if len(data) < _HEAD.size or data[:4] != _MAGIC:
            raise InputError("the service sent what is no frame; are both of one version?")
        _, number, channels, buckets, begin, step, first = _HEAD.unpack_from(data)
        pairs = np.frombuffer(data, "<f4", offset=_HEAD.size).reshape(channels, buckets, 2)
        return cls(begin, step, first, pairs[:, :, 0], pairs[:, :, 1], number)
