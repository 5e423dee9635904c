"""Loops whose board computes the drive: samples come in blocks, which the host observes, answers and records.

The order of work, in C (native/blocks.h): receive, observe the block, judge its samples, answer it; then what hangs off
the loop.  Where blocks have piled up all of them are observed, and only the newest is answered.  Nothing is lost
without being counted: what the link did not take the board counts, what is missing between two ticks the host, which
marks the gap in the capture.
"""

import ctypes

import numpy as np

from estimator.core.layout import OUTPUT
from hil.running.native import MOST_ROWS, NONE, BlocksState
from hil.running.skeleton import Setup
from hil.running.turns import TurnLoop


class BlockLoop(TurnLoop):
    """One run in a mode of which samples come in blocks."""

    def __init__(self, setup: Setup) -> None:
        identity, bench, observer = setup.identity, setup.bench, setup.observer
        self._blocks = BlocksState(began=NONE)
        super().__init__(setup, self._blocks)
        self._scale = np.array([identity.sense_scale_V] * 2 + [identity.drive_scale_mps2] * 2)
        blocks, block = self._blocks, bench.loop.block
        blocks.rows = block
        blocks.every = bench.loop.estimate_every
        blocks.covariance_every = bench.loop.covariance_stride(self._rate_Hz) // block
        blocks.clip, blocks.saturation = 2 ** (identity.sense_bits - 1) - 1, self._drive_limit
        units = (*observer.volts, *[observer.scaling.drive] * 2)
        for column in range(4):
            blocks.code[column], blocks.unit[column] = self._scale[column], units[column]
        self._columns = np.zeros((2, MOST_ROWS, 2))  # z and u of a block
        self._outputs = np.zeros(MOST_ROWS, OUTPUT)

    def _bind(self) -> None:
        blocks = self._blocks
        blocks.z, blocks.u = (column.ctypes.data for column in self._columns)
        blocks.outputs = self._outputs.ctypes.data
        self._state.blocks = ctypes.addressof(blocks)

    def _close(self) -> None:
        super()._close()
        self._blocks.closed = 1

    def _begin_again(self) -> None:
        self._blocks.began = NONE
