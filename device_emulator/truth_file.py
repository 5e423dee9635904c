"""The truth file: the true state at every row, for `hil score` and nobody else.

Arrow IPC stream; columns `tick` (int64), `TRUTH_COLUMNS` (float64) and `CODE_COLUMNS` (int32), the codes that the board
sent of that row, by which the score knows the truth of the run from that of another, with trim electrodes
`STIFFNESS_COLUMNS` as they were softened; what the numbers mean stands in
the schema's metadata under `gyrohil`. Each block is written whole, so a kill leaves those before it readable.
"""

import contextlib
import errno
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from device_emulator.device import CODE_COLUMNS, STIFFNESS_COLUMNS, TRUTH_COLUMNS
from device_emulator.scenario import Scenario
from device_emulator.seal import SealedStream
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
        f"sense_gain_V{'_s' if scenario.sense.kind == 'piezo' else ''}_per_m": list(sense_gain(scenario)),
        "noise_V": scenario.sense.noise_V,
        "seed": scenario.seed if seed is None else seed,
        **({"trimmed": True} if scenario.trim else {}),
        "effects": [{"name": effect.name, "coefficients": effect.coefficients} for effect in scenario.effect],
    }


class TruthFile:
    """Writes the rows of a device, one in `metadata["every"]`, starting with tick 0."""

    def __init__(self, path: Path, metadata: Mapping[str, Any]) -> None:
        """Raises `ScenarioError` when the file cannot be made, or is there already."""
        self._every = int(metadata["every"])
        schema = pa.schema(
            [
                ("tick", pa.int64()),
                *((name, pa.float64()) for name in TRUTH_COLUMNS),
                *((name, pa.int32()) for name in CODE_COLUMNS),
                *((name, pa.float64()) for name in STIFFNESS_COLUMNS if metadata.get("trimmed")),
            ]
        )
        self._path = path
        self._sealed = SealedStream(schema, metadata)
        try:
            self._file = path.open("xb", buffering=0)
        except FileExistsError:
            raise ScenarioError(f"{path}: exists already; give another truth file, or remove it") from None
        except OSError as error:
            raise self._refused(error) from None
        self._size = 0
        self._ticks: list[NDArray[np.int64]] = []
        self._rows: list[NDArray[np.float64]] = []
        self._waiting = 0
        self._put_down(self._sealed.opening())

    def add(self, first_tick: int, rows: NDArray[np.float64]) -> None:
        """Take rows, shape (n, 12), of consecutive ticks; they are copied. Whole blocks go to the file.

        Raises `ScenarioError` when it cannot be written; it then ends with its last whole block.
        """
        skip = -first_tick % self._every
        self._rows.append(rows[skip :: self._every].copy())
        self._ticks.append(np.arange(first_tick + skip, first_tick + len(rows), self._every, dtype=np.int64))
        self._waiting += len(self._rows[-1])
        if self._waiting >= BLOCK_ROWS:
            self._write()

    def close(self) -> None:
        """Write what is left and end the stream; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self._write()
            self._put_down(self._sealed.end())
            os.fsync(self._file.fileno())
        except OSError as error:
            raise self._refused(error) from None
        finally:
            self._file.close()

    def _write(self) -> None:
        if self._waiting:
            columns = np.concatenate(self._rows).T
            ends = len(TRUTH_COLUMNS), len(TRUTH_COLUMNS) + len(CODE_COLUMNS)
            states, codes, springs = np.split(columns, ends)
            each = *states, *codes.astype(np.int32), *springs
            arrays = [pa.array(np.concatenate(self._ticks)), *map(pa.array, each)]
            self._ticks, self._rows, self._waiting = [], [], 0
            self._put_down(self._sealed.block(arrays))

    def _put_down(self, data: bytes) -> None:
        """All of it or, where the disk has no room, nothing and the end of the file."""
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) or 0 :]
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
            self._file.close()
            raise self._refused(error) from None
        self._size += len(data)

    def _refused(self, error: OSError) -> ScenarioError:
        why = os.strerror(error.errno or errno.EIO)
        return ScenarioError(f"{self._path}: cannot write the truth file ({why})")
