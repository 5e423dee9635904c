"""The truth file: the true state at every row, for `hil score` and nobody else.

Arrow IPC stream; columns `tick` (int64) and `TRUTH_COLUMNS` (float64); what the numbers mean stands in the
schema's metadata under `gyrohil`. Each block is written whole, so a kill leaves those before it readable.
"""

import errno
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from device_emulator.device import TRUTH_COLUMNS
from device_emulator.scenario import Scenario
from device_emulator.section import ScenarioError
from device_emulator.sense import sense_gain

BLOCK_ROWS = 4096


def truth_metadata(scenario: Scenario, seed: int | None, every: int = 1) -> dict[str, Any]:
    """What is constant about the truth: parameters per unit mass, gains, noise, hidden effects."""
    truth = scenario.truth
    return {
        "kind": "truth",
        "version": 1,
        "every": every,
        "sample_rate_Hz": scenario.board.sample_rate_Hz,
        "mass_kg": truth.mass_kg,
        "stiffness_per_s2": [k / truth.mass_kg for k in truth.stiffness_N_per_m],
        "damping_per_s": [d / truth.mass_kg for d in truth.damping_N_s_per_m],
        "sense_gain_V_per_m": list(sense_gain(scenario)),
        "noise_V": scenario.sense.noise_V,
        "seed": scenario.seed if seed is None else seed,
        "effects": [{"name": effect.name, "coefficients": effect.coefficients} for effect in scenario.effect],
    }


class TruthFile:
    """Writes the rows of a device, one in `metadata["every"]`, starting with tick 0."""

    def __init__(self, path: Path, metadata: Mapping[str, Any]) -> None:
        """Raises `ScenarioError` when the file cannot be made."""
        self._every = int(metadata["every"])
        schema = pa.schema(
            [("tick", pa.int64()), *((name, pa.float64()) for name in TRUTH_COLUMNS)],
            metadata={b"gyrohil": json.dumps(metadata, sort_keys=True).encode()},
        )
        try:
            self._file = pa.OSFile(str(path), "wb")  # unbuffered
        except OSError as error:
            why = os.strerror(error.errno or errno.EIO)  # Arrow's own text repeats the path
            raise ScenarioError(f"{path}: cannot write the truth file ({why})") from None
        self._writer = pa.ipc.new_stream(self._file, schema)
        self._schema = schema
        self._ticks: list[NDArray[np.int64]] = []
        self._rows: list[NDArray[np.float64]] = []
        self._waiting = 0

    def add(self, first_tick: int, rows: NDArray[np.float64]) -> None:
        """Take rows, shape (n, 8), of consecutive ticks; they are copied. Whole blocks go to the file."""
        skip = -first_tick % self._every
        self._rows.append(rows[skip :: self._every].copy())
        self._ticks.append(np.arange(first_tick + skip, first_tick + len(rows), self._every, dtype=np.int64))
        self._waiting += len(self._rows[-1])
        if self._waiting >= BLOCK_ROWS:
            self._write()

    def close(self) -> None:
        """Write what is left and end the stream; a second call does nothing."""
        if not self._file.closed:
            self._write()
            self._writer.close()
            self._file.close()

    def _write(self) -> None:
        if self._waiting:
            columns = np.concatenate(self._rows).T
            arrays = [pa.array(np.concatenate(self._ticks)), *(pa.array(column) for column in columns)]
            self._writer.write_batch(pa.record_batch(arrays, schema=self._schema))
            self._ticks, self._rows, self._waiting = [], [], 0
